"""Error of integration against wall time, both of the same run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import Scene, Simulator, max_timestep
from flag_env.physics.tuning import ACCURACIES
from flag_env.studies import energy_budget, reference
from flag_env.studies.accuracy_scenes import METHODS, stepped
from flag_env.studies.refinement import resampled

TIMES = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Instants at which the error is read [s]."""

SHARES = (0.95, 0.5, 0.25, 0.125, 0.0625)
"""Shares of the step limit."""

DTYPES = ("float64", "float32")

Array = NDArray[np.float64]


Case = tuple[str, float | None, Scene]
"""Method or accuracy preset, share of the step limit, and the scene to run."""


def truth(scene: Scene) -> list[Any]:
    """Positions at `TIMES` from `reference`."""
    return list(reference.solve(scene, TIMES).positions.tolist())


def cases(scene: Scene, dtype: str, shares: Sequence[float], methods: Sequence[str]) -> list[Case]:
    """Every method and share, and the accuracy presets of this dtype, whose share is theirs to choose."""
    grid: list[Case] = [
        (name, share, stepped(scene.replace(integrator=METHODS[name], dtype=dtype), share, TIMES[0]))
        for name in methods
        for share in shares
    ]
    presets = ((name, scene.tuned(name)) for name in ACCURACIES)
    return grid + [(name, None, tuned) for name, tuned in presets if tuned.dtype == dtype]


def measure(
    name: str, chosen: list[Case], expected: Array, rounds: int, window: float, tick: Callable[[], object]
) -> list[dict[str, Any]]:
    """One row for each case; the cases take turns, and each counts with its fastest turn.

    Parameters
    ----------
    name
        Of the scene.
    chosen
        See `cases`.
    expected : (times, layers, rows, cols, 3)
        See `truth` [m].
    rounds
        Timed turns.
    window
        Time over which the energy budget is drawn up [s].
    tick
        Called after each turn of each case.
    """
    simulators = [Simulator(scene) for _, _, scene in chosen]
    starts = [simulator.get_state() for simulator in simulators]
    for simulator in simulators:
        simulator.step(1)  # compiles
    best, found = [float("inf")] * len(chosen), [np.zeros(())] * len(chosen)
    for _ in range(rounds):
        for i, simulator in enumerate(simulators):
            simulator.set_state(starts[i])
            spent, poses = _timed(simulator)
            best[i], found[i] = min(best[i], spent), poses
            tick()
    rows = []
    for (method, share, scene), simulator, seconds, poses in zip(chosen, simulators, best, found, strict=True):
        size = scene.lattice.shape[1:]  # a coarser lattice is compared at its own material points
        apart = np.linalg.norm(poses - resampled(expected, *size), axis=-1).reshape(len(TIMES), -1)
        rows.append(
            {
                "scene": name,
                "method": method,
                "dtype": scene.dtype,
                "share of limit": simulator.timestep / max_timestep(scene) if share is None else share,
                "preset": share is None,
                "timestep [s]": simulator.timestep,
                "wall time per simulated s": seconds / TIMES[-1],
                "RMS error [m]": _rms(apart[-1]),
                "worst error [m]": float(apart[-1].max()),
                "energy residual": energy_budget.residual(scene, window),
                "RMS errors [m]": [_rms(row) for row in apart],
                "worst errors [m]": apart.max(axis=1).tolist(),
            }
        )
        tick()
    return rows


def _timed(simulator: Simulator) -> tuple[float, Array]:
    """Seconds of stepping, and positions at `TIMES`."""
    spent, poses = 0.0, []
    for _ in TIMES:
        steps = round(TIMES[0] / simulator.timestep)
        start = time.perf_counter()
        simulator.step(steps)
        spent += time.perf_counter() - start
        poses.append(simulator.positions[0])
    return spent, np.array(poses)


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def front(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those rows of one scene, presets apart, that no other beats in both wall time and RMS error, the quickest first."""
    kept: list[dict[str, Any]] = []
    grid = [row for row in rows if not row["preset"]]
    for row in sorted(grid, key=lambda row: (row["wall time per simulated s"], row["RMS error [m]"])):
        if not kept or row["RMS error [m]"] < kept[-1]["RMS error [m]"]:
            kept.append(row)
    return kept


def excess(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Wall time of each preset over that of the front at its error, between points by straight lines in the logarithms.

    Beyond the front's ends its last point counts. Rows of one scene.
    """
    best = [(row["RMS error [m]"], row["wall time per simulated s"]) for row in front(rows)]
    errors, seconds = np.log(np.transpose(best[::-1]))
    return {
        row["method"]: float(row["wall time per simulated s"] / np.exp(np.interp(np.log(row["RMS error [m]"]), errors, seconds)))
        for row in rows
        if row["preset"]
    }


def gain(rows: list[dict[str, Any]]) -> float:
    """Error of the report's scheme over that of LFAB at half its limit, at equal wall time, in float64; rows of one scene."""
    double = [row for row in rows if row["dtype"] == "float64"]
    ours = next(row for row in double if row["method"] == "LFAB" and row["share of limit"] == 0.5)
    theirs = sorted(
        (row["wall time per simulated s"], row["RMS error [m]"]) for row in double if row["method"] == "leapfrog (report)"
    )
    seconds, errors = np.log(np.transpose(theirs))
    equal = np.exp(np.interp(np.log(ours["wall time per simulated s"]), seconds, errors))
    return float(equal / ours["RMS error [m]"])
