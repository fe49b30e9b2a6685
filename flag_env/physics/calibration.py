"""How large a scene's integration error is, measured; and the cheapest way to integrate it with an error asked for.

The error is the distance between a path and the scene's exact one: RMS over the particles, worst of the 25 film frames (0.04 s
apart) of the first second, and worst of the starts: the scene's own, that of a `Simulator` of seed 0, and, where displaced starts
are to be covered, `DISPLACED` more in which every free particle is displaced by itself: the hardest way, since it stirs the
stiffest motions. The exact path stands for itself by RK4 in float64, its timestep halved until two paths agree well within the
error that is asked for. The scene moves under its own forces; where no wind blows, air of 8 m/s along x, 5.3 across and 3.3
upwards sets in at once, a force of (12, 8, 5) m/s^2 times the mean particle mass.

Every way is judged by runs of its own, never by an extrapolation, and costs are counted, not timed: the same call gives the same
answer, whether it is found or remembered (see `flag_env.physics.calibration_store`).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import calibration_store
from flag_env.physics.effects.cosine_wind import CosineWind
from flag_env.physics.effects.wind import Wind
from flag_env.physics.integrators import LFAB, RK4, Integrator, Strang
from flag_env.physics.scene import Scene
from flag_env.physics.simulator import Simulator
from flag_env.physics.stability import AUTO, UNLIMITED, max_timestep
from flag_env.physics.state import Diverged

FRAME = 0.04
"""Time between two frames [s]; timesteps are whole fractions of it."""

FRAMES = 25
"""Frames of a calibration: one second."""

GUST = (12.0, 8.0, 5.0)
"""Acceleration of the cloth by the wind that blows where a scene has none of its own (x, y, z) [m/s^2]."""

AIR = 1.5
"""Rate at which moving air that is given a velocity counts as an acceleration of the cloth [1/s]."""

SAFETY = 2.0
"""Measured errors stay below the tolerance by this factor: a flag may meet other winds than the calibration's."""

DISPLACED = 3
"""Displaced starts that a calibration tries."""

HALVINGS = 4
"""Times that the reference's timestep is halved before a tolerance counts as out of reach."""

COST = {
    (LFAB, "float32"): 0.5,
    (LFAB, "float64"): 1.0,
    (RK4, "float32"): 2.2,
    (Strang, "float32"): 2.4,
    (Strang, "float64"): 3.0,
    (RK4, "float64"): 3.8,
}
"""Candidates, and the time of one step, as a multiple of LFAB's in float64: measured on flags of 10 x 16 to 40 x 64 particles."""

RESOLVED = 0.02
"""A path is exact when halving its timestep moves it by no more than this share of the tolerance."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """The cheapest way found: method, timestep [s], dtype, and the error measured with it [m]."""

    integrator: Integrator
    timestep: float
    dtype: str
    error: float


@lru_cache(maxsize=256)
def calibrate(scene: Scene, tolerance: float, displaced: float = 0.0) -> Calibration:
    """The cheapest integrator, timestep and dtype whose error stays below `tolerance` [m].

    Parameters
    ----------
    scene
        The scene.
    tolerance
        Error asked for [m].
    displaced
        RMS displacement of the particles in starts other than the scene's own that are to be covered too [m].

    Raises
    ------
    ValueError
        If an effect has no order of accuracy, or the tolerance is out of reach.
    """
    check_smooth(scene)
    file = calibration_store.file_of(scene, tolerance, displaced)
    found = _from_store(calibration_store.load(file))
    if found is None:
        found, steps = _search(scene, tolerance, displaced)
        answer = {"integrator": type(found.integrator).__name__, "steps": steps, "dtype": found.dtype, "error": found.error}
        calibration_store.keep(file, answer)
    return found


def _from_store(answer: dict[str, Any] | None) -> Calibration | None:
    """The calibration that was stored; None where there is none, or none that makes sense."""
    kinds = {(kind.__name__, dtype): kind for kind, dtype in COST}
    try:
        name, steps, dtype, error = (answer or {})["integrator"], answer["steps"], answer["dtype"], answer["error"]  # type: ignore[index]
        return Calibration(kinds[name, dtype](), FRAME / int(steps), dtype, float(error))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None


def _search(scene: Scene, tolerance: float, displaced: float) -> tuple[Calibration, int]:
    """The calibration, and its number of steps to a frame."""
    excited = _excited(scene)
    exact = _reference(excited, tolerance, displaced)
    best, fewest, best_cost = None, 0, math.inf
    floors = {(kind, dtype): cost * _fewest(excited.replace(integrator=kind())) for (kind, dtype), cost in COST.items()}
    for (kind, dtype), floor in sorted(floors.items(), key=lambda item: item[1]):
        if floor >= best_cost:  # even at its step limit it costs more than what is found already
            break
        found = _coarsest(excited.replace(integrator=kind(), dtype=dtype), exact, tolerance / SAFETY, displaced)
        if found is not None and (cost := COST[kind, dtype] * found[0]) < best_cost:
            fewest, best_cost = found[0], cost
            best = Calibration(kind(), FRAME / fewest, dtype, found[1])
    if best is None:
        raise _out_of_reach(tolerance, None)
    return best, fewest


@lru_cache(maxsize=256)
def error_of(scene: Scene, timestep: float) -> float:
    """Error of the scene as it stands, from its own start, at a timestep lowered to a whole fraction of a frame [m].

    Infinite if it diverges.

    Raises
    ------
    ValueError
        If an effect has no order of accuracy, or no reference path is to be had.
    """
    check_smooth(scene)
    excited = _excited(scene)
    path = _path(excited, math.ceil(FRAME / timestep - 1e-9), 0.0)
    rough = _distance(path, _path(_standard(excited), 2 * _fewest(_standard(excited)), 0.0))
    if not math.isfinite(rough):
        return math.inf
    return _distance(path, _reference(excited, max(rough, 1e-12), 0.0))


def check_smooth(scene: Scene) -> None:
    """Raise ValueError where an effect leaves integrators without an order of accuracy."""
    rough = ", ".join(type(effect).__name__ for effect in scene.effects if not effect.smooth)
    if rough:
        raise ValueError(
            f"scene must hold no {rough} for a tolerance in metres, since no order of accuracy is defined there; leave it out "
            "with scene.without(...), or take accuracy 'fast', 'balanced' or 'reference', which promise no error there"
        )


def _excited(scene: Scene) -> Scene:
    """The scene in the wind of the calibration."""
    winds = [effect for effect in scene.effects if isinstance(effect, Wind)]
    if any(np.any(wind.mean) or np.any(wind.amplitude) for wind in winds):
        return scene.replace(allow_unstable=False, timestep="auto")
    wind = winds[0] if winds else CosineWind()
    unit = float(scene.lattice.masses.mean()) if wind.unit == "N" else 1.0 / AIR
    blowing = dataclasses.replace(wind, mean=tuple(unit * entry for entry in GUST))  # type: ignore[call-arg]
    return scene.replace(allow_unstable=False, timestep="auto").adding(blowing)


def _standard(scene: Scene) -> Scene:
    return scene.replace(integrator=RK4(), dtype="float64")


def _longest(scene: Scene, integrator: Integrator) -> float:
    """Longest timestep that is tried [s]."""
    limit = max_timestep(scene.replace(integrator=integrator))
    return min(FRAME, AUTO * limit) if math.isfinite(limit) else UNLIMITED


def _fewest(scene: Scene) -> int:
    """Least number of steps to a frame."""
    return max(1, math.ceil(FRAME / _longest(scene, scene.integrator) - 1e-9))


@lru_cache(maxsize=16)
def _path(scene: Scene, steps: int, displaced: float) -> Array:
    """Positions at every frame [m], (frames, starts, particles, 3), at `steps` timesteps a frame; NaN from a divergence on."""
    starts = 1 + DISPLACED * (displaced > 0.0)
    simulator = Simulator(scene.replace(timestep=FRAME / steps), copies=starts)
    if displaced:
        simulator.set_positions(simulator.positions + _displacements(scene, starts, displaced))
    path = np.full((FRAMES, starts, scene.lattice.size, 3), np.nan)
    for frame in path:
        try:
            simulator.step(steps)
        except Diverged:
            break
        frame[:] = simulator.positions.reshape(starts, -1, 3)
    return path


def _displacements(scene: Scene, starts: int, displaced: float) -> Array:
    """Of every particle at each start [m]: none at the first, then normal ones of this RMS along the axes that can move."""
    lattice = scene.lattice
    drawn = np.zeros((starts, lattice.size, 3))
    axes = list(lattice.axes)
    drawn[1:, :, axes] = np.random.default_rng(0).standard_normal((starts - 1, lattice.size, len(axes)))
    drawn[:, lattice.fixed] = 0.0
    return displaced / math.sqrt(len(axes)) * drawn.reshape(starts, *lattice.shape, 3)


def _distance(path: Array, other: Array) -> float:
    """Worst RMS distance over frames and starts [m]; infinite where a path diverged."""
    worst = float(np.sqrt(((path - other) ** 2).sum(axis=-1).mean(axis=-1)).max())
    return worst if math.isfinite(worst) else math.inf


def _reference(scene: Scene, tolerance: float, displaced: float) -> Array:
    """A path whose own error is far below `tolerance`; raise ValueError where there is none."""
    standard = _standard(scene)
    steps, least = 2 * _fewest(standard), math.inf
    path = _path(standard, steps, displaced)
    for _ in range(HALVINGS):
        steps *= 2
        coarser, path = path, _path(standard, steps, displaced)
        apart = _distance(path, coarser)
        if apart <= RESOLVED * tolerance:
            return path
        least = min(least, apart)
    raise _out_of_reach(tolerance, least)


def _out_of_reach(tolerance: float, apart: float | None) -> ValueError:
    reason = "" if apart is None else f"; halving the timestep still moves it by {apart:.2g} m"
    allowed = "a larger tolerance" if apart is None or not math.isfinite(apart) else f"at least {1.01 * apart / RESOLVED:.3g} m"
    return ValueError(
        f"accuracy must be {allowed} for this scene, got {tolerance:g} m: its path over one second, past its horizon or down at "
        f"round-off, is not known that well{reason}"
    )


def _coarsest(scene: Scene, exact: Array, tolerance: float, displaced: float) -> tuple[int, float] | None:
    """About the fewest steps to a frame with an error within `tolerance`, and that error; None where round-off ends it."""
    steps, last = _fewest(scene), math.inf
    most = steps * 2 ** (2 + HALVINGS)
    while steps <= most:
        error = _distance(_path(scene, steps, displaced), exact)
        if error <= tolerance:
            return steps, error
        if error > 0.9 * last:
            return None
        last = error
        growth = (error / tolerance) ** (1.0 / scene.integrator.order) if math.isfinite(error) else 2.0
        steps = max(steps + 1, math.ceil(steps * min(growth, 2.0**HALVINGS)))
    return None
