"""Error against wall time, both of the same run.

Timesteps are those an environment can use: shares of the step limit, from the 0.9 of `timestep="auto"` down, lowered to whole
fractions of an action of 0.04 s. An accuracy preset that is one of these points is run once and stands for both. A preset of a
coarser lattice is compared at its own material points: its error is the lattice's and the integration's, which is also held
against the coarser lattice's own path.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.control import CONTROL_STEP
from flag_env.physics import Lattice, Scene, Simulator, max_timestep, tune
from flag_env.physics.accuracy import ACCURACIES
from flag_env.studies import energy_budget, reference
from flag_env.studies.accuracy_scenes import METHODS, stepped
from flag_env.studies.refinement import resampled

TIMES = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Instants at which the error is read [s]."""

SHARES = (0.9, 0.5, 0.25, 0.125, 0.0625)
"""Shares of the step limit."""

DTYPES = ("float64", "float32")

SECONDS, ERROR = "wall time per simulated s", "RMS error [m]"
"""What a point of work and precision is made of."""

SLOW = 0.2
"""Wall time of a simulated second from which two turns are enough [s]."""

LESS = 0.99
"""An error of at least this share of another is no better: float64 and float32 often differ by less."""

Array = NDArray[np.float64]

Case = tuple[str, float | None, Scene]
"""Method or accuracy preset, share of the step limit, and the scene to run."""


def truth(scene: Scene) -> list[Any]:
    """Positions at `TIMES` from `reference`."""
    return list(reference.solve(scene, TIMES).positions.tolist())


def grid(scene: Scene, dtype: str, shares: Sequence[float], methods: Sequence[str]) -> list[Case]:
    """Every method and share."""
    return [
        (name, share, stepped(scene.replace(integrator=METHODS[name], dtype=dtype), share, CONTROL_STEP))
        for name in methods
        for share in shares
    ]


def presets(scene: Scene) -> list[Case]:
    """The accuracy presets, whose share is theirs to choose."""
    return [(name, None, tune(scene, name, multiple_of=CONTROL_STEP)) for name in ACCURACIES]


def measure(
    name: str,
    chosen: list[Case],
    lattice: Lattice,
    expected: Mapping[Lattice, Array],
    rounds: int,
    window: float,
    tick: Callable[[], object],
) -> list[dict[str, Any]]:
    """One row for each case; the cases take turns, and each counts with the fastest of its turns on each stretch of the way.

    Parameters
    ----------
    name
        Of the scene.
    chosen
        See `grid` and `presets`.
    lattice
        Of the scene as it is: errors are distances to its path.
    expected
        What each lattice of the cases does, (times, layers, rows, cols, 3) [m]; see `truth`.
    rounds
        Timed turns; two for cases slower than `SLOW`.
    window
        Time over which the energy budget is drawn up [s].
    tick
        Called after each turn of each scene.
    """
    simulators = {scene: Simulator(scene) for _, _, scene in chosen}
    starts = {scene: simulator.get_state() for scene, simulator in simulators.items()}
    for simulator in simulators.values():
        simulator.step(1)  # compiles
    best = dict.fromkeys(simulators, np.full(len(TIMES), math.inf))
    poses: dict[Scene, Array] = {}
    for turn in range(rounds):
        for scene, simulator in simulators.items():
            if turn >= 2 and best[scene].sum() > SLOW:
                continue
            simulator.set_state(starts[scene])
            spent, poses[scene] = _timed(simulator)
            best[scene] = np.minimum(best[scene], spent)
            tick()
    found = {}
    for scene, simulator in simulators.items():
        size = scene.lattice.shape[1:]
        apart = np.linalg.norm(poses[scene] - resampled(expected[lattice], *size), axis=-1).reshape(len(TIMES), -1)
        alone = np.linalg.norm(poses[scene] - expected[scene.lattice], axis=-1).reshape(len(TIMES), -1)
        found[scene] = {
            "timestep [s]": simulator.timestep,
            SECONDS: float(best[scene].sum() / TIMES[-1]),
            ERROR: _rms(apart[-1]),
            "worst error [m]": float(apart[-1].max()),
            "integration alone [m]": _rms(alone[-1]),
            "energy residual": energy_budget.residual(scene, window),
            "RMS errors [m]": [_rms(row) for row in apart],
            "worst errors [m]": apart.max(axis=1).tolist(),
        }
        tick()
    return [
        {
            "scene": name,
            "lattice": "{1} x {0}".format(*scene.lattice.shape[1:]),
            "method": method,
            "dtype": scene.dtype,
            "share of limit": _share(scene) if share is None else share,
            "preset": share is None,
            **found[scene],
        }
        for method, share, scene in chosen
    ]


def _share(scene: Scene) -> float:
    """Share of its step limit that a scene with a timestep in numbers takes."""
    return float(scene.timestep) / max_timestep(scene)


def _timed(simulator: Simulator) -> tuple[Array, Array]:
    """Seconds of stepping to each of `TIMES`, and positions there."""
    spent, poses = [], []
    for _ in TIMES:
        steps = round(TIMES[0] / simulator.timestep)
        start = time.perf_counter()
        simulator.step(steps)
        spent.append(time.perf_counter() - start)
        poses.append(simulator.positions[0])
    return np.array(spent), np.array(poses)


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def front(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those rows of one scene that no other beats, the quickest first: none is better in wall time or RMS error and not worse."""
    kept: list[dict[str, Any]] = []
    for row in sorted(rows, key=lambda row: (row[SECONDS], row[ERROR])):
        same = bool(kept) and (row[SECONDS], row[ERROR]) == (kept[-1][SECONDS], kept[-1][ERROR])
        if not kept or row[ERROR] < kept[-1][ERROR] or same:
            kept.append(row)
    return kept


def lead(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Wall time of the quickest more accurate point over that of each preset: above 1 for points of the front.

    More accurate is what has less than `LESS` of the error. Rows of one scene.
    """
    return {
        row["method"]: min(
            (other[SECONDS] / row[SECONDS] for other in rows if other[ERROR] < LESS * row[ERROR]), default=math.inf
        )
        for row in rows
        if row["preset"]
    }


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What each preset takes and gives, and its `lead`; rows of one scene."""
    leads = lead(rows)
    return [
        {
            "accuracy": row["method"],
            "particles": row["lattice"],
            "1 s takes [ms]": 1e3 * row[SECONDS],
            "error after 1 s [mm]": 1e3 * row[ERROR],
            "without the lattice's [mm]": 1e3 * row["integration alone [m]"],
            "what is more accurate takes": f"{leads[row['method']]:.2f} times as long",
        }
        for row in rows
        if row["preset"]
    ]


def gain(rows: list[dict[str, Any]]) -> float:
    """Error of the report's scheme over that of LFAB at half its limit, at equal wall time, in float64; rows of one scene."""
    double = [row for row in rows if row["dtype"] == "float64"]
    ours = next(row for row in double if row["method"] == "LFAB" and row["share of limit"] == 0.5)
    theirs = sorted((row[SECONDS], row[ERROR]) for row in double if row["method"] == "leapfrog (report)")
    seconds, errors = np.log(np.transpose(theirs))
    equal = np.exp(np.interp(np.log(ours[SECONDS]), seconds, errors))
    return float(equal / ours[ERROR])
