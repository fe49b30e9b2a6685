"""The picture of a learning curve."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator, PercentFormatter

from flag_env._files import replacing

INK, MUTED = "#1f2933", "#8a96a3"
LINES = {"success_5": ("within 5 %", "#0b6e99"), "success_3": ("within 3 %", "#e07a1f")}


def draw(path: Path, curve: list[dict[str, Any]], baselines: dict[str, dict[str, Any]], title: str) -> None:
    """Write success and distance on validation targets over the timesteps as a PNG.

    Parameters
    ----------
    path
        File to write.
    curve
        Points: "timesteps" and what `evaluate.summary` returns.
    baselines
        Name -> summary of policies that do not learn.
    title
        Title of the figure.
    """
    figure = Figure(figsize=(9, 3.8), dpi=150, layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold", color=INK)
    success, distance = figure.subplots(1, 2)
    steps = [point["timesteps"] for point in curve]
    for name, (label, colour) in LINES.items():
        values = [point[name] for point in curve]
        success.plot(steps, values, "o-", color=colour, lw=2, ms=4, label=f"agent {label}", clip_on=False, zorder=3)
    medians = [float("nan") if point["median_distance"] is None else point["median_distance"] for point in curve]
    distance.plot(steps, medians, "o-", color=LINES["success_5"][1], lw=2, ms=4, label="agent", zorder=3)
    for (name, result), style in zip(baselines.items(), ("--", ":", "-."), strict=False):
        success.axhline(result["success_5"], color=MUTED, ls=style, lw=1.4, label=f"{name} within 5 %")
        if result["median_distance"] is not None:
            distance.axhline(result["median_distance"], color=MUTED, ls=style, lw=1.4, label=name)
    distance.axhspan(0, 0.05, color=LINES["success_5"][1], alpha=0.1, lw=0, label="5 % tolerance")
    success.set_title("Success, held for 10 steps", loc="left", fontsize=10, color=INK)
    success.set_ylim(0, 1)
    distance.set_title("Median final distance, in flag diagonals", loc="left", fontsize=10, color=INK)
    distance.set_ylim(0, None)
    for axes in (success, distance):
        axes.set_xlim(0, max(steps[-1], 1))
        axes.set_xlabel("environment steps", color=INK)
        axes.xaxis.set_major_formatter(EngFormatter(sep=" "))
        axes.yaxis.set_major_locator(MaxNLocator(steps=[1, 2, 5, 10]))
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
        axes.grid(color="#e6eaee", lw=0.8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(colors=INK, length=0)
        axes.legend(frameon=False, fontsize=8, loc="best")
    with replacing(path) as partial:
        FigureCanvasAgg(figure).print_png(partial)  # type: ignore[no-untyped-call]
