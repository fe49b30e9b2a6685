"""The figure of what `tune` promises beside what is true."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from flag_env.studies.accuracy_figure import COLOURS

NAMES = {"Leapfrog": "leapfrog (report)", "LFAB": "LFAB", "Strang": "Strang", "RK4": "RK4", "Implicit": "implicit"}
"""Integrators as the accuracy study calls them."""

LEAST = 1e-18
"""Error that is drawn for none [m]."""


def draw(rows: list[dict[str, Any]]) -> Figure:
    """Error over promise, each scene a point; calm ones are discs, others squares, float32 is hollow."""
    figure = Figure(figsize=(8.4, 8.4), layout="constrained")
    axes = figure.subplots()
    ends = [min(row["promised [m]"] for row in rows) / 3, 3 * max(row["promised [m]"] for row in rows)]
    axes.plot(ends, ends, color="#1b1b1b", linewidth=1.2)
    axes.fill_between(ends, ends, [1e9 * end for end in ends], color="#c8372d", alpha=0.08, linewidth=0)
    axes.text(ends[0] * 2, ends[0] * 3e3, "promise broken", color="#c8372d", clip_on=True, in_layout=False)
    for method in dict.fromkeys(row["integrator"] for row in rows):
        colour = COLOURS.get(NAMES.get(method, ""), "#9aa3ad")
        axes.plot([], [], "o", color=colour, label=method)
        for row in (row for row in rows if row["integrator"] == method):
            marker = "o" if row["scene"].endswith("calm") else "s"
            fill = colour if row["dtype"] == "float64" else "white"
            place = row["promised [m]"], max(row["error [m]"], LEAST)
            axes.plot(*place, marker, color=colour, markerfacecolor=fill, markersize=5)
    axes.plot([], [], "o", color="#555", label="calm")
    axes.plot([], [], "s", color="#555", label="in wind")
    axes.plot([], [], "o", color="#555", markerfacecolor="white", label="float32")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*ends)
    lowest = min(max(row["error [m]"], 1e-3 * row["promised [m]"]) for row in rows)  # scenes at rest stay below the frame
    axes.set_ylim(lowest / 3, ends[1])
    axes.set_xlabel("accuracy asked for [m]")
    axes.set_ylabel("true error, worst of all steps of a second [m]")
    axes.set_title(f"Promised and true error of {len(rows)} scenes")
    axes.legend(frameon=False, loc="lower right")
    axes.spines[["top", "right"]].set_visible(False)
    return figure
