"""The figure of the accuracy study."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, NullLocator

from flag_env.studies import work_precision

COLOURS = {
    "explicit Euler": "#9aa3ad",
    "leapfrog (report)": "#c8372d",
    "leapfrog (half kick)": "#e8a33d",
    "LFAB": "#1f5fa8",
    "Strang": "#2a9d72",
    "RK4": "#7a4fb5",
    "implicit": "#1b1b1b",
}
SCENE_COLOURS = {"Flag-v0": "#7a4fb5", "calm": "#2a9d72", "gusty": "#c8372d", "two-layer": "#1f5fa8"}

LABELS = {"fast": ((0, -19), "center"), "balanced": ((-9, -10), "right"), "reference": ((-9, -10), "right")}
"""Places of the presets' names from their stars [points], and how they are set: before the front, where nothing is."""


def draw(
    rows: list[dict[str, Any]], space: list[dict[str, Any]], growths: dict[str, Any], averages: list[dict[str, Any]]
) -> Figure:
    """Work and precision of each scene above; space, growth of errors and averages below."""
    figure = Figure(figsize=(14.5, 8), layout="constrained")
    above, below = figure.subplots(2, 4)
    for axes, scene in zip(above, growths, strict=False):
        _work(axes, scene, [row for row in rows if row["scene"] == scene])
    errors = [row[work_precision.ERROR] for row in rows]
    for axes in above:
        axes.set_ylim(0.3 * min(errors), 5 * max(errors))
    for axes in above[len(growths) :]:
        axes.set_axis_off()
    above[0].set_ylabel("RMS position error after 1 s [m]")
    _legend(figure)
    _space(below[0], space)
    _growth(below[1], growths)
    _averages(below[2], below[3], averages)
    for axes in (*above, *below):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _work(axes: Any, scene: str, rows: list[dict[str, Any]]) -> None:
    best = work_precision.front(rows)
    axes.plot(*_points(best), color="#f2cf63", linewidth=9, alpha=0.6, solid_capstyle="round", zorder=0)
    presets = [row for row in rows if row["preset"]]
    own = next(row["lattice"] for row in presets if row["method"] == "balanced")
    for method, colour in COLOURS.items():
        for dtype, style, fill in (("float64", "-", colour), ("float32", ":", "white")):
            curve = [row for row in rows if row["method"] == method and row["dtype"] == dtype]
            finer = [row for row in curve if row["lattice"] == own]
            looks = {"color": colour, "markerfacecolor": fill}
            axes.plot(*_points(finer), style, marker="o", markersize=4.5, linewidth=1.3, **looks)
            coarser = [row for row in curve if row["lattice"] != own]
            axes.plot(*_points(coarser), marker="s", linestyle="", markersize=3.0, alpha=0.6, **looks)
    for row in presets:
        place = row[work_precision.SECONDS], row[work_precision.ERROR]
        axes.plot(*place, marker="*", color="#d61f8d", markersize=15, markeredgecolor="white", zorder=5)
        offset, side = LABELS[row["method"]]
        axes.annotate(
            row["method"], place, xytext=offset, textcoords="offset points", ha=side,
            fontsize=9, color="#a1146a", weight="bold", zorder=6,
        ).set_in_layout(False)  # fmt: skip
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.set_xlim(low * (low / high) ** 0.22, high)  # room for the presets' names
    axes.set_yscale("log")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_title(scene)
    axes.set_xlabel("wall time for 1 simulated second [s]")
    axes.grid(which="major", color="#e6e8eb", linewidth=0.6)


def _points(rows: list[dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Wall times and errors."""
    return [row[work_precision.SECONDS] for row in rows], [row[work_precision.ERROR] for row in rows]


def _legend(figure: Figure) -> None:
    handles = [Line2D([], [], color=colour, marker="o", markersize=4.5, label=method) for method, colour in COLOURS.items()]
    handles += [
        Line2D([], [], color="#555", linestyle=":", marker="o", markerfacecolor="white", markersize=4.5, label="float32"),
        Line2D([], [], color="#555", linestyle="", marker="s", markersize=3.5, label="8 x 5 particles"),
        Line2D([], [], color="#f2cf63", linewidth=9, alpha=0.6, label="Pareto front"),
    ]
    handles.append(Line2D([], [], color="#d61f8d", marker="*", linestyle="", markersize=13, label="accuracy presets"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False, fontsize=9)


def _space(axes: Any, space: list[dict[str, Any]]) -> None:
    colours = ("#9cc3e6", "#4d8cc9", "#14457d")
    quantities = [key for key in space[0] if key.startswith("RMS at")]
    for quantity, colour in zip(quantities, colours, strict=True):
        seconds = [row["wall time per simulated s"] for row in space[:-1]]
        axes.plot(seconds, [row[quantity] for row in space[:-1]], "o-", color=colour, label=quantity.split()[2] + " s")
    for row in space[:-1]:
        place = row["wall time per simulated s"], row[quantities[-1]]
        axes.annotate(row["lattice"], place, xytext=(5, 5), textcoords="offset points", fontsize=9)
    axes.axvline(space[-1]["wall time per simulated s"], color="#9aa3ad", linestyle="--", linewidth=1)
    finest = space[-1]["wall time per simulated s"]
    axes.text(finest, 0.03, f"{space[-1]['lattice']} ", ha="right", transform=axes.get_xaxis_transform(), fontsize=9)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.margins(0.15)
    axes.set_title("Space: distance to the finest lattice")
    axes.set_xlabel("wall time for 1 simulated second [s]")
    axes.set_ylabel("RMS distance [mm]")
    axes.legend(frameon=False, title="after", loc="upper right", bbox_to_anchor=(0.9, 1.0))


def _growth(axes: Any, growths: dict[str, Any]) -> None:
    for scene, found in growths.items():
        rate = f"{found['rate']:+.2f} /s"
        axes.plot(found["times"], found["distances"], color=SCENE_COLOURS[scene], linewidth=1.2, label=f"{scene}, {rate}")
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(1e-15, 0.3 * min(min(found["distances"]) for found in growths.values())))
    axes.set_title("Horizon: two copies 1e-9 m apart")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("RMS distance [m]")
    axes.legend(frameon=False)


def _averages(axes: Any, beside: Any, averages: list[dict[str, Any]]) -> None:
    """Every mean and interval over the standard's mean, those of a quantity one below the other; the legend stands beside."""
    beside.set_axis_off()
    if not averages:
        axes.text(0.5, 0.5, "No scene outlives its horizon.", ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    first = averages[0]["scene"]
    rows = [row for row in averages if row["scene"] == first]
    names = list(dict.fromkeys(row["quantity"] for row in rows))
    runs = list(dict.fromkeys(row["run"] for row in rows))
    for i, run in enumerate(runs):
        own = [row for row in rows if row["run"] == run]
        unit = [next(r["mean"] for r in rows if r["quantity"] == row["quantity"]) for row in own]
        middle = np.array([row["mean"] for row in own]) / unit
        low, high = (np.array([row[key] for row in own]) / unit for key in ("low", "high"))
        place = np.arange(len(names)) + (i - (len(runs) - 1) / 2) * 0.14
        colour = next((value for name, value in COLOURS.items() if run.startswith(name)), "#d61f8d")
        open_ = {"markerfacecolor": "white"} if "float32" in run else {}
        axes.errorbar(middle, place, xerr=(middle - low, high - middle), fmt="o", color=colour, markersize=4, label=run, **open_)
    axes.axvline(1.0, color="#9aa3ad", linewidth=0.8, zorder=0)
    axes.set_yticks(range(len(names)), [name.replace(" from the standard's mean [m]", "\nfrom its mean") for name in names])
    axes.invert_yaxis()
    axes.set_title(f"32 flags, {first}, {rows[0]['from [s]']:.0f} to {rows[0]['to [s]']:.0f} s")
    axes.set_xlabel("averages over LFAB's at half its limit, 95 %")
    beside.legend(*axes.get_legend_handles_labels(), frameon=False, fontsize=9, loc="center left")
