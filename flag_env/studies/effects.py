"""What each effect costs: nanoseconds per particle-step, and its share of its scene's step.

A scene's step is timed whole, without any effect (the integrator alone) and with each effect alone; what an effect adds to the
integrator is its cost. Costs and integrator must sum to the whole: the study prints how well they do. Start times come from fresh
processes, first with an empty cache, then with a filled one.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from tqdm import tqdm

from flag_env.physics import Scene, Simulator, presets
from flag_env.studies import report
from flag_env.studies.timing import fastest

_START = """
import time
begin = time.perf_counter()
from flag_env.studies.effects import scenes
from flag_env.physics import Simulator
imported = time.perf_counter()
Simulator(scenes()[{name!r}]).step(1)
print(time.perf_counter() - imported)
"""


def scenes() -> dict[str, Scene]:
    """The scenes that are taken apart, by name."""
    flag = presets.flag()
    return {
        "rope": presets.rope(640),
        "sheet": presets.sheet(),
        "flag": flag,
        "flag, float32": flag.replace(dtype="float32"),
        "two_layer_flag": presets.two_layer_flag(),
        "report_flag": presets.report_flag(),
        "storm": presets.storm_flag(),
    }


def measure(name: str, scene: Scene, rounds: int) -> list[dict[str, Any]]:
    """Rows for one scene: the integrator, each effect, their sum, the whole."""
    timestep = Simulator(scene).timestep
    fixed = scene.replace(timestep=timestep, allow_unstable=True, perturbation=0.0)
    parts = {"integrator": fixed.replace(effects=()), "whole step": fixed}
    parts |= {type(effect).__name__: fixed.replace(effects=(effect,)) for effect in fixed.effects}
    simulators = {part: Simulator(cut) for part, cut in parts.items()}
    starts = {part: simulator.get_state() for part, simulator in simulators.items()}
    steps = max(1, 300_000 // scene.lattice.size)

    def job(part: str) -> Any:
        def run() -> None:
            simulators[part].set_state(starts[part])
            simulators[part].step(steps)

        return run

    times = fastest({part: job(part) for part in parts}, rounds)
    per = {part: 1e9 * seconds / (steps * scene.lattice.size) for part, seconds in times.items()}
    whole, base = per.pop("whole step"), per.pop("integrator")
    costs = {"integrator": base} | {part: max(time - base, 0.0) for part, time in per.items()}
    rows = [_row(name, part, cost, whole) for part, cost in costs.items()]
    return [*rows, _row(name, "sum", sum(costs.values()), whole), _row(name, "whole step", whole, whole)]


def _row(scene: str, part: str, cost: float, whole: float) -> dict[str, Any]:
    return {"scene": scene, "part": part, "ns per particle-step": cost, "share": cost / whole}


def start_times(name: str) -> dict[str, Any]:
    """Seconds from the import to the end of the first step, with an empty and with a filled cache."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        command = [sys.executable, "-c", _START.format(name=name)]
        first, cached = (
            float(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout) for _ in range(2)
        )
    return {"scene": name, "first step ever [s]": first, "first step from cache [s]": cached}


def run(output: Path, quick: bool) -> None:
    """Measure, print the tables, write effects.json and effects.png."""
    chosen = scenes()
    rows: list[dict[str, Any]] = []
    for name, scene in tqdm(chosen.items(), desc="cost"):
        rows += measure(name, scene, rounds=5 if quick else 20)
    names = ["flag"] if quick else list(chosen)
    starts = [start_times(name) for name in tqdm(names, desc="start")]
    report.write(output, "effects", rows, _figure(rows), starts=starts)
    print(report.table(starts))


def _figure(rows: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    axes = figure.subplots()
    names = list(dict.fromkeys(row["scene"] for row in rows))
    parts = list(dict.fromkeys(row["part"] for row in rows if row["part"] not in ("sum", "whole step")))
    colours = dict(zip(parts, _palette(len(parts)), strict=True))
    for height, name in enumerate(names):
        left = 0.0
        for row in rows:
            if row["scene"] != name or row["part"] in ("sum", "whole step"):
                continue
            cost = row["ns per particle-step"]
            axes.barh(height, cost, left=left, color=colours[row["part"]], label=row["part"], edgecolor="white", linewidth=0.5)
            left += cost
        whole = next(row for row in rows if row["scene"] == name and row["part"] == "whole step")["ns per particle-step"]
        axes.plot([whole, whole], [height - 0.45, height + 0.45], color="black", linewidth=1.5, label="whole step, measured")
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(unique.values(), unique.keys(), frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("nanoseconds per particle and step, one thread")
    axes.set_title("A scene pays for its own effects only")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _palette(count: int) -> list[Any]:
    from matplotlib import colormaps

    return [colormaps["tab20"](index % 20) for index in range(count)]
