"""What gradients through the simulator cost, and how long they stay useful.

Cost: processor time of a value with its gradient beside the same run of a `Simulator` that is handed the same wind, one flag on
one thread; and the memory of the steps that are kept. Horizon: the loss is half the mean square displacement at time t, its
gradient that with respect to all wind set-points up to then, in units of the full wind; beside it the slope of the loss over a
finite step along random directions. Where small changes grow, the gradient's norm grows with them, and its agreement with a
finite step goes: the loss is no longer straight over such a step. Beyond that point a gradient is right and useless.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tqdm import tqdm

from flag_env.control import CONTROL_STEP, WindControl, wind_of
from flag_env.physics import Rollout, Scene, Simulator, effects, presets
from flag_env.physics.integrators import LFAB
from flag_env.studies import report
from flag_env.studies.timing import fastest

Array = NDArray[np.float64]

COPIES, STEP = 8, 0.02
"""Random directions, one a copy; length of the finite step along them, as a share of the full wind."""

WINDS = {"calm": (0.0, 0.0), "breeze": (6.0, 1.0), "storm": (6.0, 3.0)}
"""Mean wind acceleration along x [m/s^2], and size of random gusts in shares of the full wind; calm: the flag falls and hangs."""

GUST = 10
"""Control steps that a gust lasts: long enough for the cloth to follow it."""


def scene(rows: int, cols: int, mean: float, dtype: str) -> Scene:
    """The environments' flag in a wind."""
    flag = presets.flag(rows, cols, integrator=LFAB(), dtype=dtype)
    blowing = wind_of(flag, np.array([mean, 0.0, 0.0]))
    wind = effects.CosineWind(mean=tuple(blowing.tolist()), frequency=tuple(WindControl.frequency.tolist()))
    return flag.adding(wind)


def costs(rounds: int, actions: int) -> list[dict[str, Any]]:
    """A row for each size and dtype."""
    rows = []
    for height, width in ((10, 16), (20, 32)):
        for dtype in ("float32", "float64"):
            flag = scene(height, width, 6.0, dtype)
            simulator = Simulator(flag, threads=1)
            per_action = max(round(CONTROL_STEP / simulator.timestep), 1)
            wind = 0.3 * wind_of(flag, WindControl.gain) * np.random.default_rng(0).standard_normal((actions, 1, 3))
            by = np.ones((1, *flag.lattice.shape, 3))
            seconds = actions * per_action * simulator.timestep
            some, every = Rollout(flag, threads=1, parameters=()), Rollout(flag, threads=1)
            times = fastest(
                {
                    "forward": lambda: _forward(simulator, wind, per_action),  # noqa: B023
                    "value": lambda: some.run(wind=wind, seconds=seconds),  # noqa: B023
                    "wind": lambda: _there_and_back(some, wind, seconds, by),  # noqa: B023
                    "all": lambda: _there_and_back(every, wind, seconds, by),  # noqa: B023
                },
                rounds,
                clock=time.process_time,
            )
            per_step = 2 * 3 * np.dtype(dtype).itemsize
            rows.append(
                {
                    "flag": f"{height} x {width}",
                    "dtype": dtype,
                    "steps": actions * per_action,
                    "forward run (ms)": 1e3 * times["forward"],
                    "value / forward": times["value"] / times["forward"],
                    "value and gradient by wind / forward": times["wind"] / times["forward"],
                    "by wind and all parameters / forward": times["all"] / times["forward"],
                    "bytes a particle-step": per_step,
                }
            )
    return rows


def _forward(simulator: Simulator, wind: Array, steps: int) -> None:
    for amplitude in wind:
        simulator.set_wind(amplitude=amplitude)
        simulator.step(steps)


def _there_and_back(rollout: Rollout, wind: Array, seconds: float, by: Array) -> None:
    rollout.run(wind=wind, seconds=seconds)
    rollout.pull_back(by)


def horizon(name: str, times: list[float]) -> list[dict[str, Any]]:
    """A row for each time: norm of the gradient, and its median relative disagreement with finite steps."""
    mean, size = WINDS[name]
    flag = scene(10, 16, mean, "float64")
    full = wind_of(flag, WindControl.gain)
    actions = round(max(times) / CONTROL_STEP)
    rng = np.random.default_rng(0)
    gusts = np.repeat(rng.uniform(-1, 1, (-(-actions // GUST), 1, 3)), GUST, axis=0)[:actions]
    wind = size * full * gusts * np.ones((1, COPIES, 1))
    rollout = Rollout(flag, COPIES, parameters=(), memory=5e8)
    direction = rng.standard_normal(wind.shape)
    rest = flag.lattice.rest_positions
    rows = []
    for moment in tqdm(times, desc=name):
        count = round(moment / CONTROL_STEP)
        along = direction[:count] / np.sqrt(np.square(direction[:count]).sum(axis=(0, 2), keepdims=True))
        loss = _loss(rollout, count * CONTROL_STEP, rest)
        ahead, behind = (loss(wind[:count] + sign * STEP * full * along) for sign in (1, -1))
        found = (ahead - behind) / (2 * STEP)
        loss(wind[:count])
        gradient = rollout.pull_back((rollout.path[-1] - rest) / flag.lattice.size).wind
        assert gradient is not None
        told = (gradient * full * along).sum(axis=(0, 2))
        norm = float(np.median(np.sqrt(np.square(gradient * full).sum(axis=(0, 2)))))
        apart = float(np.median(np.abs(told - found) / np.maximum(np.abs(told), np.abs(found))))
        rows.append({"wind": name, "time (s)": moment, "gradient norm (m^2)": norm, "disagreement": apart})
    return rows


def _loss(rollout: Rollout, seconds: float, rest: Array) -> Callable[[Array], Array]:
    def loss(wind: Array) -> Array:
        x = rollout.run(wind=wind, seconds=seconds)
        return np.asarray(0.5 * np.square(x - rest).sum(axis=-1).mean(axis=(1, 2, 3)))

    return loss


def run(output: Path, quick: bool) -> None:
    """Measure, print the tables, write gradients.json and gradients.png."""
    cost = costs(rounds=2 if quick else 15, actions=10 if quick else 75)
    times = [0.4, 0.8] if quick else [0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]
    found = [row for name in WINDS for row in horizon(name, times)]
    print(report.table(found))
    report.write(output, "gradients", cost, _figure(cost, found), horizon=found)


def _figure(cost: list[dict[str, Any]], found: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    names = ["value / forward", "value and gradient by wind / forward", "by wind and all parameters / forward"]
    for k, (name, colour) in enumerate(zip(names, ("#9aa3ad", "#c8372d", "#4a5560"), strict=True)):
        left.bar(
            np.arange(len(cost)) + 0.27 * (k - 1), [row[name] for row in cost], 0.25, color=colour, label=name.split(" /")[0]
        )
    left.set_xticks(range(len(cost)), [f"{row['flag']}\n{row['dtype']}" for row in cost], fontsize=8)
    left.set(ylabel="times a forward run", title="Cost")
    left.legend(frameon=False, fontsize=8)
    for name, colour in zip(WINDS, ("#4a5560", "#2d7dc8", "#c8372d"), strict=True):
        mine = [row for row in found if row["wind"] == name]
        moments = [row["time (s)"] for row in mine]
        middle.semilogy(moments, [row["gradient norm (m^2)"] for row in mine], "o-", color=colour, label=name)
        right.semilogy(moments, [row["disagreement"] for row in mine], "o-", color=colour, label=name)
    middle.set(xlabel="time (s)", ylabel="norm (m$^2$ a full wind)", title="Gradient")
    right.set(xlabel="time (s)", ylabel=f"relative, over a step of {100 * STEP:g} %", title="Disagreement with a finite step")
    right.axhline(1.0, color="#9aa3ad", lw=0.8)
    middle.legend(frameon=False, fontsize=8)
    for axes in (left, middle, right):
        axes.spines[["top", "right"]].set_visible(False)
    return figure
