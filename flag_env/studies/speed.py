"""How fast the package is, as ratios to baselines measured in the same run; one table, one figure, one JSON file.

Every row has a bar, which the project holds itself to, and an aim. Baselines that are not installed are left out and said so.
Other machines' work comes and goes on a shared processor, so all is measured in several passes, each of them a comparison
of its own: the median pass of each figure counts, and what the others came to is told. The roofline is measured once.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from tqdm import tqdm

from flag_env.studies import report, speed_envs, speed_kernels, speed_starts
from flag_env.studies.roofline import draw, roofline
from flag_env.studies.speed_rows import Row, median

PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "one flag": speed_kernels.one_flag,
    "many flags": speed_kernels.many_flags,
    "simulated seconds": speed_kernels.simulated_seconds,
    "growing lattices": speed_kernels.growing,
    "one environment": speed_envs.one_environment,
    "vector environment": speed_envs.vector_environment,
    "frames": speed_envs.frames,
    "starts": speed_starts.starts,
}


PASSES = 5


def run(output: Path, quick: bool) -> None:
    """Measure, print the table, write speed.json and speed.png."""
    passes: list[list[Row]] = [[] for _ in range(1 if quick else PASSES)]
    with tqdm(total=len(passes) * len(PARTS), desc="speed") as bar:
        for rows in passes:
            for name, part in PARTS.items():
                bar.set_postfix_str(name)
                rows += part(quick)
                bar.update()
    rows = [median(of_one_figure) for of_one_figure in zip(*passes, strict=True)]
    bound = roofline(quick)
    report.write(output, "speed", [row.entry() for row in rows], _figure(rows, bound), roofline=bound)
    print("\nwhat the kernel could do, and does (20 x 32, one thread):")
    print(f"floating-point instructions by register: {bound.pop('instructions')}")
    print(report.table([{"": name, **values} for name, values in bound.items()]))


def _figure(rows: list[Row], bound: dict[str, dict[str, Any]]) -> Figure:
    """How many times better than its bar each figure is, a tick where the aim stands; below, what bounds the kernel."""
    judged = [row for row in rows if row.bar]
    height = 0.36 * len(judged) + 1.2
    figure = Figure(figsize=(8.5, height + 3.4), layout="constrained")
    axes, below = figure.subplots(2, 1, height_ratios=(height, 3.4))
    draw(below, bound)
    places = range(len(judged), 0, -1)
    colors = {"aim": "#2e8b57", "bar": "#e0a030", "no": "#c8372d", "": "#9aa3ad"}
    axes.barh(places, [row.share(row.measured) for row in judged], color=[colors[row.reached] for row in judged], height=0.62)
    for place, row in zip(places, judged, strict=True):
        axes.plot([row.share(row.least), row.share(row.most)], [place] * 2, color="#20262e", lw=0.8)
        axes.plot([row.share(row.aim)] * 2, [place - 0.4, place + 0.4], color="#20262e", lw=2)
        axes.annotate(
            f"  {row.measured:.3g} {row.unit}",
            (max(map(row.share, (row.least, row.most, row.aim))), place),
            va="center",
            fontsize=8,
        )
    axes.axvline(1.0, color="#20262e", lw=0.8, ls=":")
    axes.set_xscale("log")
    axes.set_xlim(0.3, axes.get_xlim()[1] * 2.5)
    axes.set_yticks(list(places), [row.figure for row in judged], fontsize=8)
    axes.set_xlabel("times better than the bar (dotted); tick: the aim; line: least and most of all passes")
    axes.spines[["top", "right"]].set_visible(False)
    return figure
