"""How close to the edge a scene runs: measured outcomes over stiffness or viscosity and timestep, beside the predicted limit.

A small flag is shaken and put into a wind, at every stiffness (or viscosity) and timestep of a grid, with every integrator. It
stays a flag, it grows (a link ends at more than one and a half times its length), or it diverges (numbers that are not finite).
Besides: how sharp the limit is on random scenes (`margins`), what it costs to know it (`limit_times`), whether undamped cloth
heats below it (`heating`), and what looking for non-finite numbers costs.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from tqdm import tqdm

from flag_env.physics import Diverged, Scene, Simulator, diagnostics, max_timestep, presets
from flag_env.physics.compiling import CHECK_EVERY, first_non_finite, jit
from flag_env.physics.effects import CosineWind
from flag_env.physics.integrators import Implicit, Integrator
from flag_env.studies import report
from flag_env.studies.heating import heating
from flag_env.studies.limit_times import limit_times
from flag_env.studies.margins import METHODS, margins
from flag_env.studies.timing import fastest

OUTCOMES = ("stable", "grows", "diverged")
COLOURS = ("#cfe3ef", "#f4b860", "#b5403b")

AXES = {"stiffness": ((30.0, 3e4), "N/m"), "viscosity": ((1e-3, 3.0), "N s/m")}
"""What is varied, over which range, and its unit."""

TIMESTEPS = (1e-4, 3e-2)
STEPS = 3000
WIND = np.array([3.0, 5.0, 1.0])
"""Amplitude of the wind [m/s^2]."""


def scene(method: Integrator, stiffness: float = 300.0, viscosity: float = 0.1) -> Scene:
    """The flag of a cell of the map."""
    flag = presets.flag(5, 6, stiffness=stiffness, viscosity=viscosity, integrator=method)
    push = float(flag.lattice.masses.mean()) * WIND
    return flag.adding(CosineWind(tuple(push), (4.0, 6.0, 9.0), tuple(push / 2)))


def outcome(flag: Scene, timestep: float) -> int:
    """Number of the outcome of a run of `STEPS` steps."""
    simulator = Simulator(flag.replace(timestep=timestep, allow_unstable=True))
    velocities = 0.3 * np.random.default_rng(0).standard_normal(simulator.velocities.shape)
    velocities[:, :, :, 0] = 0.0
    simulator.set_velocities(velocities)
    try:
        simulator.step(STEPS)
    except Diverged:
        return 2
    with np.errstate(over="ignore"):  # what grows beyond all bounds has no strain
        return int(not diagnostics.strain(flag.lattice, simulator.positions).max() <= 0.5)


def chart(method: Integrator, varied: str, columns: int, rows: int) -> dict[str, Any]:
    """One map: outcomes (rows, columns) over the grid, and the predicted limit [s] at each column; None where there is none."""
    values, timesteps = np.geomspace(*AXES[varied][0], columns), np.geomspace(*TIMESTEPS, rows)
    flags = [scene(method, **{varied: float(value)}) for value in values]
    found = [[outcome(flag, float(h)) for flag in flags] for h in timesteps]
    known = [max_timestep(flag) for flag in flags]
    codes, shares = np.array(found), timesteps[:, None] / np.array(known)
    return {
        "integrator": type(method).__name__,
        "varied": varied,
        "values": values.tolist(),
        "timesteps": timesteps.tolist(),
        "limits": [limit if np.isfinite(limit) else None for limit in known],
        "outcomes": found,
        "unstable below the limit": int((codes[shares <= 1] > 0).sum()),
        "cells below": int((shares <= 1).sum()),
        "stable above 1.35 limits": int((codes[shares > 1.35] == 0).sum()),
        "cells above": int((shares > 1.35).sum()),
    }


@jit
def _checks(x: Any, v: Any, count: int) -> int:
    found = 0
    for _ in range(count):
        found += first_non_finite(x, v)
    return found


def check_cost(rounds: int) -> list[dict[str, Any]]:
    """Share of a step that the look for non-finite numbers takes, in a long run and within the steps of one action."""
    rows = []
    for rows_, cols, dtype in ((10, 16, "float32"), (20, 32, "float64")):
        simulator = Simulator(presets.flag(rows_, cols, dtype=dtype))
        steps, x, v = CHECK_EVERY * 20, simulator.run.x[0], simulator.run.v[0]
        times = fastest({"step": partial(simulator.step, steps), "check": partial(_checks, x, v, 1000)}, rounds)
        share = (times["check"] / 1000) / (times["step"] / steps)
        row = {"flag": f"{rows_} x {cols}, {dtype}", "step [us]": 1e6 * times["step"] / steps, "check [us]": 1e3 * times["check"]}
        rows.append(row | {"share, every 50 steps": share / CHECK_EVERY, "share, every 20 steps": share / 20})
    return rows


def run(output: Path, quick: bool) -> None:
    """Measure, print the tables, write stability.json and stability.png."""
    methods = (*METHODS, Implicit())
    size = (9, 12) if quick else (15, 27)
    charts = []
    with tqdm(total=len(AXES) * len(methods), desc="maps") as bar:
        for varied in AXES:
            for method in methods:
                charts.append(chart(method, varied, *size))
                bar.update()
    random = [margins(method, 6 if quick else 300) for method in tqdm(METHODS, desc="random scenes")]
    costs, checks = limit_times(2, 5) if quick else limit_times(20, 200), check_cost(5 if quick else 30)
    counts = ("integrator", "varied", "unstable below the limit", "cells below", "stable above 1.35 limits", "cells above")
    rows = [{name: one[name] for name in counts} for one in charts]
    heat = heating(10_000 if quick else 100_000)
    more = {"random": random, "limit_times": costs, "heating": heat, "finite_check": checks, "maps": charts}
    report.write(output, "stability", rows, _figure(charts), **more)
    for told in (random, costs, heat, checks):
        print(report.table(told))


def _figure(charts: list[dict[str, Any]]) -> Figure:
    names = list(dict.fromkeys(one["integrator"] for one in charts))
    figure = Figure(figsize=(2.35 * len(names), 6.2), layout="constrained")
    grid = figure.subplots(len(AXES), len(names), sharey=True, squeeze=False)
    colours = ListedColormap(COLOURS)
    for one in charts:
        row, column = list(AXES).index(one["varied"]), names.index(one["integrator"])
        axes = grid[row, column]
        axes.set_xscale("log")
        axes.set_yscale("log")
        edges = [_edges(np.array(one[name])) for name in ("values", "timesteps")]
        axes.pcolormesh(*edges, np.array(one["outcomes"]), cmap=colours, vmin=-0.5, vmax=2.5, edgecolors="white", linewidth=0.3)
        known = [(value, limit) for value, limit in zip(one["values"], one["limits"], strict=True) if limit is not None]
        if known:
            axes.plot(*zip(*known, strict=True), color="black", linewidth=1.8)
        else:
            axes.text(0.5, 0.93, "no limit", transform=axes.transAxes, ha="center", va="top", fontsize=9)
        axes.set_xlim(edges[0][0], edges[0][-1])
        axes.set_ylim(edges[1][0], edges[1][-1])
        axes.set_xlabel(f"{one['varied']} [{AXES[one['varied']][1]}]")
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        if row == 0:
            axes.set_title(one["integrator"], fontsize=11)
        if column == 0:
            axes.set_ylabel("timestep [s]")
    handles: list[Any] = [Patch(facecolor=colour, label=name) for colour, name in zip(COLOURS, OUTCOMES, strict=True)]
    handles.append(grid[0, 0].plot([], [], color="black", linewidth=1.8, label="predicted limit")[0])
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle("A flag in wind: what happened at each timestep, and the limit known before it ran")
    return figure


def _edges(centres: Any) -> Any:
    """Edges of cells around logarithmically spaced centres."""
    ratio = np.sqrt(centres[1] / centres[0])
    return np.append(centres / ratio, centres[-1] * ratio)
