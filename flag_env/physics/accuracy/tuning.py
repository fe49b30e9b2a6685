"""Accuracy as a dial: `tune` and `describe`.

A number in metres is a promise: a calibration (see `calibration`) finds the cheapest integrator, timestep and
dtype whose error stays below it at every step of the first second of the scene's own motion, from its own start and, if asked,
from displaced ones. A name is a recipe, a point of the work-precision front of `presets.flag(10, 16)`, applied without a
measurement:

| name | lattice | integrator, dtype | timestep | error of that flag, one second |
|---|---|---|---|---|
| "fast" | half the particles along and up | LFAB, float32 | 0.9 of the limit | 0.1 mm, beside what the coarser lattice costs |
| "balanced" | as it is | LFAB, float32 | 0.9 of the limit | below 1 mm (0.03 mm) |
| "reference" | as it is | RK4, float64 | half the limit | below 1 micrometre (0.1) |

"fast" halves a plain cloth only: one layer of at least 5 x 5 particles, pinned by a name, whose effects all have a coarser form
(`Effect.coarsened`). Size, areal density and stiffness per width are held, as in `presets.flag`; forces given per particle follow
its mass. Any other scene keeps its lattice, so that "fast" is "balanced" there.
"""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

from flag_env import _validate
from flag_env.physics.accuracy.calibration import calibrate, error_of
from flag_env.physics.integrators import LFAB, RK4
from flag_env.physics.limits import limited_by, max_timestep, timestep_of
from flag_env.physics.runtime import Diverged
from flag_env.physics.scene import Scene
from flag_env.physics.simulator import Simulator

ACCURACIES = ("fast", "balanced", "reference")
"""The recipes, from the cheapest to the most accurate."""

SMALLEST = 5
"""Rows and columns below which a lattice is not halved."""

REFERENCE_SHARE = 0.5
"""Share of RK4's step limit that "reference" takes."""

_TRIAL = 0.01
"""Time for which a scene is run to see how fast it is [s]."""


def tune(scene: Scene, accuracy: str | float, displaced: float = 0.0, multiple_of: float | None = None) -> Scene:
    """A new scene, as cheap as may be at an accuracy.

    Parameters
    ----------
    scene
        The scene; its lattice, effects and start count, and its integrator as one of those that are tried.
    accuracy
        A number [m], > 0: integrator, timestep and dtype are the cheapest whose integration error (RMS over the particles) stays
        below it at every step of the first second of the scene's own motion, found by a calibration of some seconds that is kept
        on disk. Or a recipe: "fast" (a plain cloth on a lattice half as fine), "balanced" or "reference"; see
        `flag_env.physics.accuracy.tuning`.
    displaced
        RMS displacement of the particles, each by itself, in starts that a number is to cover too [m]; 0: the scene's own
        start alone. Other poses set by hand, velocities, a wind set later or a mast that moves are not covered: put a wind that
        is to come into the scene. Recipes take no notice.
    multiple_of
        Time that is to be a whole number of timesteps, such as a control step [s]; None: a recipe's timestep is tied to nothing,
        a number's is a whole fraction of a second.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it may be; if a number is out of reach, where the least that is not is named and accepted, or
        the scene holds an effect, such as a collision, for which integrators have no order of accuracy.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {scene!r}")
    displaced = _validate.number("displaced", displaced, minimum=0.0)
    if multiple_of is not None:
        multiple_of = _validate.number("multiple_of", multiple_of, above=0.0)
    if isinstance(accuracy, str):
        _validate.choice("accuracy", accuracy, ACCURACIES)
        return _recipe(_halved(scene) if accuracy == "fast" else scene, accuracy == "reference", multiple_of)
    found = calibrate(scene, _validate.number("accuracy", accuracy, above=0.0), displaced, multiple_of)
    return scene.replace(integrator=found.integrator, timestep=found.timestep, dtype=found.dtype, allow_unstable=False)


def divided(scene: Scene, multiple_of: float) -> Scene:
    """The scene with its timestep lowered to a whole fraction of `multiple_of` [s]."""
    return scene.replace(timestep=multiple_of / max(1, math.ceil(multiple_of / timestep_of(scene) - 1e-9)))


def _recipe(scene: Scene, exact: bool, multiple_of: float | None) -> Scene:
    """The scene as "reference" or "balanced" has it."""
    method, dtype = (RK4(), "float64") if exact else (LFAB(), "float32")
    scene = scene.replace(integrator=method, dtype=dtype, timestep="auto", allow_unstable=False)
    limit = max_timestep(scene)
    scene = scene.replace(timestep=REFERENCE_SHARE * limit if exact and math.isfinite(limit) else timestep_of(scene))
    return scene if multiple_of is None else divided(scene, multiple_of)


def _halved(scene: Scene) -> Scene:
    """The scene with half the particles along and up, if it is a plain cloth; else as it is."""
    old = scene.lattice
    plain = old.layers == 1 and old.dimensions == 3 and isinstance(old.pinned, str)
    if not plain or min(old.rows, old.cols) < SMALLEST:
        return scene
    rows, cols = (old.rows + 1) // 2, (old.cols + 1) // 2
    along, up = old.extent[0] / (cols - 1), old.extent[1] / (rows - 1)
    share = (rows * cols) / old.size
    lattice = dataclasses.replace(old, rows=rows, cols=cols, spacing=(along, up, min(along, up)), mass=old.mass / share)
    finer = min(old.spacings[:2])
    effects = [coarse for effect in scene.effects if (coarse := effect.coarsened(share)) is not None]
    if len(effects) < len(scene.effects):
        return scene
    return scene.replace(lattice=lattice, effects=tuple(effects), perturbation=scene.perturbation * min(along, up) / finer)


@dataclasses.dataclass(frozen=True)
class Description:
    """What a scene costs and how far it can be trusted; `str()` of it is for reading.

    Attributes
    ----------
    integrator, dtype
        As in the scene.
    timestep
        "auto" resolved [s].
    limit, limited_by
        Step limit [s], infinite where there is none; what sets it, such as "the stiffness of Structural", or None.
    particles
        Number of particles.
    steps, evaluations
        Timesteps and evaluations of the forces in one simulated second.
    wall
        Time that one simulated second takes here, one copy, measured now [s].
    error
        Integration error within one second from the scene's own start [m]: RMS over the particles, worst of its steps, measured
        as in `flag_env.physics.accuracy.calibration`; infinite for a scene that diverges, None where it is not known.
    reason
        Why the error is not known; else empty.
    """

    integrator: str
    dtype: str
    timestep: float
    limit: float
    limited_by: str | None
    particles: int
    steps: float
    evaluations: float
    wall: float
    error: float | None
    reason: str

    def __str__(self) -> str:
        share = "no limit" if math.isinf(self.limit) else f"{self.timestep / (self.limit or math.nan):.2f} of the limit"
        if 0 < self.limit < math.inf:
            share += f" of {1e3 * self.limit:.4g} ms"
        setter = f", set by {self.limited_by}" if self.limited_by else ""
        error = (
            f"{1e3 * self.error:.2g} mm RMS within one second from its own start"
            if self.error is not None
            else f"not known: {self.reason}"
        )
        per = self.steps * self.particles
        return (
            f"integrator         {self.integrator}, {self.dtype}\n"
            f"timestep           {1e3 * self.timestep:.4g} ms; {share}{setter}\n"
            f"cost of a second   {self.steps:.0f} steps, {self.evaluations:.0f} force evaluations, {per:.3g} particle-steps; "
            f"{1e3 * self.wall:.3g} ms here\n"
            f"integration error  {error}"
        )


def describe(scene: Scene) -> Description:
    """Integration error, cost of a simulated second, step limit and what sets it; `print` it. Runs the scene.

    Raises
    ------
    ValueError
        If the scene's timestep is above its limit and the scene does not allow that.
    """
    timestep, limit = timestep_of(scene), max_timestep(scene)
    error, reason = None, ""
    try:
        error = error_of(scene)
    except ValueError as unknown:
        reason = str(unknown)
    steps = 1.0 / timestep
    return Description(
        integrator=type(scene.integrator).__name__, dtype=scene.dtype, timestep=timestep, limit=limit,
        limited_by=limited_by(scene) if 0.0 < limit < math.inf else None, particles=scene.lattice.size, steps=steps,
        evaluations=steps * scene.integrator.evaluations, wall=_seconds_per_step(scene) * steps, error=error, reason=reason,
    )  # fmt: skip


def _seconds_per_step(scene: Scene) -> float:
    """Shortest measured time of a step, one copy on one thread [s]."""
    simulator = Simulator(scene, threads=1)
    start: Any = simulator.get_state()
    simulator.step(1)
    count, best, trials = 1, math.inf, 0
    while trials < 4:
        simulator.set_state(start)
        began = time.perf_counter()
        try:
            simulator.step(count)
        except Diverged:
            break
        took = time.perf_counter() - began
        best = min(best, took / count)
        if took < _TRIAL / 4:
            count *= 2
        else:
            trials += 1
    return best
