"""The cheapest way to integrate a scene with an error asked for; and how large its error is as it stands.

The error is the distance between a path and the scene's exact one (see `convergence`): RMS over the particles, worst over the
steps of the first second, and worst over the starts: the scene's own, that of a `Simulator` of seed 0, and, where displaced
starts are to be covered, a few in which every free particle is displaced by itself: the hardest way, since it stirs the
stiffest motions. The scene moves as it is, under its own forces: a wind that is set later is judged in a scene that holds it.

Candidates are the package's integrators and the scene's own, which may come from outside, in both dtypes. Every way is judged
by runs of its own, never by an extrapolation alone, and costs are counted, not timed, from what an integrator says that it does
in a step: the same call gives the same answer, whether it is found or remembered (see `flag_env.physics.accuracy.store`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from flag_env.physics.accuracy import store
from flag_env.physics.accuracy.convergence import RESOLVED, SECOND, Level, exact_path, longest_step
from flag_env.physics.integrators import CATALOGUE, RK4, Integrator, bandwidth
from flag_env.physics.limits import SceneSpectrum, max_timestep, timestep_of
from flag_env.physics.scene import DTYPES, Scene

SAFETY = 1.25
"""Measured errors stay below the tolerance by this factor, for the error of the exact path."""

SAFETY_DISPLACED = 2.0
"""`SAFETY` where displaced starts are covered: others may be worse than those that are tried."""

EVALUATION = {"float64": 1.0, "float32": 0.5}
"""Time of an evaluation of the forces; the unit is one in float64. Measured, as those below, on flags of 5 x 7 to 40 x 64."""

SOLUTION = {"float64": (0.3, 0.077), "float32": (0.55, 0.042)}
"""Time of a solution with a banded factor: a constant, and a multiple of the bandwidth."""

SMALLEST_IN_SINGLE = 1e-7
"""Share of a scene's size below which float32 cannot tell positions apart over a second."""

_BETTER = 0.93
"""Share of the steps of a way found that fewer must fall below to be tried."""


@dataclass(frozen=True)
class Calibration:
    """The cheapest way found: method, timestep [s], dtype, and the error measured with it [m]."""

    integrator: Integrator
    timestep: float
    dtype: str
    error: float


@dataclass
class _Candidate:
    """A way to integrate, with the number of steps to a unit of time that it is to be tried with next.

    Attributes
    ----------
    scene
        With its integrator and dtype.
    price
        Of a step.
    fewest, steps
        Least number of steps that is stable, and the next to try.
    too_few
        Most steps known to be too few; 0 if none are.
    last
        Error with those [m].
    stalled
        Whether more steps have failed to help.
    """

    scene: Scene
    price: float
    fewest: int
    steps: int
    too_few: int = 0
    last: float = math.inf
    stalled: bool = False

    @property
    def cost(self) -> float:
        """Of a unit of time."""
        return self.price * self.steps

    def expect(self, error: float, allowed: float, margin: float) -> int:
        """Steps that should bring `error` to `allowed`, by the method's order and a margin."""
        growth = (error / allowed) ** (1.0 / self.scene.integrator.order) if math.isfinite(error) else 2.0
        return math.ceil(self.steps * margin * growth)


@lru_cache(maxsize=256)
def calibrate(scene: Scene, tolerance: float, displaced: float = 0.0, multiple_of: float | None = None) -> Calibration:
    """The cheapest integrator, timestep and dtype whose error stays below `tolerance` [m].

    Parameters
    ----------
    scene
        The scene.
    tolerance
        Error asked for [m].
    displaced
        RMS displacement of the particles in starts other than the scene's own that are to be covered too [m].
    multiple_of
        Time that is to be a whole number of timesteps [s]; None: the second is.

    Raises
    ------
    ValueError
        If an effect has no order of accuracy, or the tolerance is out of reach; the least one that is not is named.
    """
    check_smooth(scene)
    unit = SECOND if multiple_of is None else multiple_of
    file = store.file_of(scene, tolerance, displaced, unit)
    found = _from_store(store.load(file), scene, unit)
    if found is None:
        found, steps = _search(scene, tolerance, displaced, unit)
        answer = {"integrator": repr(found.integrator), "steps": steps, "dtype": found.dtype, "error": found.error}
        store.keep(file, answer)
    return found


def candidates(scene: Scene) -> tuple[Integrator, ...]:
    """The integrators that are tried for a scene: the package's, and its own."""
    return tuple(dict.fromkeys((*CATALOGUE, scene.integrator)))


def price_of(scene: Scene) -> float:
    """Time of a step with the scene's integrator and dtype, as a multiple of an evaluation of its forces in float64."""
    method = scene.integrator
    price = method.evaluations * EVALUATION[scene.dtype]
    if method.solutions:
        constant, slope = SOLUTION[scene.dtype]
        price += method.solutions * (constant + slope * bandwidth(SceneSpectrum(scene.lattice, scene.effects)))
    return price


def _from_store(answer: dict[str, Any] | None, scene: Scene, unit: float) -> Calibration | None:
    """The calibration that was stored; None where there is none, or none that makes sense."""
    known = {repr(method): method for method in candidates(scene)}
    try:
        name, steps, dtype, error = (answer or {})["integrator"], answer["steps"], answer["dtype"], answer["error"]  # type: ignore[index]
        return Calibration(known[name], unit / int(steps), DTYPES[DTYPES.index(dtype)], float(error))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None


def _search(scene: Scene, tolerance: float, displaced: float, unit: float) -> tuple[Calibration, int]:
    """The calibration, and its number of steps to a unit of time."""
    exact = exact_path(bare(scene), displaced)
    level = exact.within(RESOLVED * tolerance)
    if level is None:
        raise _out_of_reach(tolerance, exact.best())
    allowed = tolerance / (SAFETY_DISPLACED if displaced else SAFETY)
    best, fewest = _exact_way(scene, level, unit)
    cost = price_of(scene.replace(integrator=best.integrator, dtype=best.dtype)) * fewest
    dtype = DTYPES[0] if allowed < SMALLEST_IN_SINGLE * scene.lattice.diagonal else DTYPES[1]
    trials = [_candidate(scene, method, dtype, unit) for method in candidates(scene) if _is_stable(scene, method)]
    while trials:
        trial = min(trials, key=lambda trial: trial.cost)
        if trial.cost >= cost:
            break
        timestep = unit / trial.steps
        error = exact.distance(trial.scene, timestep, exact.coarsest())
        if error <= allowed + exact.coarsest().known:  # else it is seen at once that there are too few steps
            error = exact.distance(trial.scene, timestep, level)
        if error <= allowed:
            cost, fewest = trial.cost, trial.steps
            best = Calibration(trial.scene.integrator, timestep, trial.scene.dtype, error)
            trial.steps = max(trial.fewest, trial.too_few + 1, trial.expect(error, allowed, 1.02))
            if trial.steps > _BETTER * fewest:
                trials.remove(trial)
            continue
        slowest = math.sqrt(trial.too_few / trial.steps)  # of what a method converges with
        stalls = trial.scene.dtype == "float32" and trial.too_few > 0 and error > slowest * trial.last
        if stalls and trial.stalled:
            trials.remove(trial)
        elif stalls:  # perhaps by rounding
            double = trial.scene.replace(dtype="float64")
            trials.append(replace(trial, scene=double, price=price_of(double), stalled=False))
        trial.stalled, trial.too_few, trial.last = stalls, trial.steps, error
        trial.steps = max(trial.expect(error, allowed, 1.01), math.ceil(1.05 * trial.steps))
    return best, fewest


def bare(scene: Scene) -> Scene:
    """The scene without what its exact path does not depend on."""
    return scene.replace(integrator=RK4(), dtype="float64", timestep="auto", allow_unstable=False)


def _exact_way(scene: Scene, level: Level, unit: float) -> tuple[Calibration, int]:
    """The exact path itself, which is always within reach."""
    steps = math.ceil(unit / min(level.timestep, longest_step(bare(scene))) - 1e-9)
    return Calibration(RK4(), unit / steps, "float64", level.known), steps


def _is_stable(scene: Scene, method: Integrator) -> bool:
    """Whether the method is stable at any timestep."""
    return max_timestep(scene.replace(integrator=method)) > 0.0


def _candidate(scene: Scene, method: Integrator, dtype: str, unit: float) -> _Candidate:
    """A way at its longest timestep."""
    way = scene.replace(integrator=method, dtype=dtype, timestep="auto", allow_unstable=False)
    fewest = max(1, math.ceil(unit / longest_step(way) - 1e-9))
    return _Candidate(way, price_of(way), fewest, fewest)


@lru_cache(maxsize=256)
def error_of(scene: Scene) -> float:
    """Error of the scene as it stands, from its own start [m]; infinite if it diverges.

    Where the exact path is not known that well, the error to which it is known.

    Raises
    ------
    ValueError
        If an effect has no order of accuracy, or the timestep is above the limit and the scene does not allow that.
    """
    check_smooth(scene)
    timestep, exact = timestep_of(scene), exact_path(bare(scene), 0.0)
    level: Level | None = exact.within(math.inf)
    while level is not None:
        error = exact.distance(scene, timestep, level)
        if level.known <= RESOLVED * error or math.isinf(error):
            return error
        level = exact.within(min(RESOLVED * error, level.known / 2))
    level = exact.best()
    return max(exact.distance(scene, timestep, level), level.known)


def check_smooth(scene: Scene) -> None:
    """Raise ValueError where an effect leaves integrators without an order of accuracy."""
    rough = ", ".join(type(effect).__name__ for effect in scene.effects if not effect.smooth)
    if rough:
        raise ValueError(
            f"scene must hold no {rough} for a tolerance in metres, since no order of accuracy is defined there; leave it out "
            "with scene.without(...), or take accuracy 'fast', 'balanced' or 'reference', which promise no error there"
        )


def _out_of_reach(tolerance: float, best: Level) -> ValueError:
    known = f"at least {1.01 * best.known / RESOLVED:.3g} m" if math.isfinite(best.known) else "a recipe's name"
    return ValueError(
        f"accuracy must be {known} for this scene, got {tolerance:g} m: its path over one second, past its horizon or down at "
        f"round-off, is known to {best.known:.2g} m in float64"
    )
