"""Accuracy as a dial: `Scene.tuned` and `Scene.describe`.

A number in metres is a promise: a calibration (see `flag_env.physics.calibration`) finds the cheapest integrator, timestep and
dtype whose error over one second stays below it, from the scene's own start and, if asked, from displaced ones. A name is a
recipe, a point of the work-precision front of `presets.flag(10, 16)`, applied without a measurement:

| name | lattice | integrator, dtype | timestep | error of that flag, one second |
|---|---|---|---|---|
| "fast" | half the particles along and up | LFAB, float32 | 0.9 of the limit | 0.1 mm, beside what the coarser lattice costs |
| "balanced" | as it is | LFAB, float32 | 0.9 of the limit | below 1 mm (0.03 mm) |
| "reference" | as it is | RK4, float64 | half the limit | below 1 micrometre (0.1) |

"fast" halves a plain cloth only: one layer of at least 5 x 5 particles, pinned by a name, whose effects all belong to `WIDTH`.
Size, areal density and stiffness per width are held, as in `presets.flag`; forces given per particle follow its mass. Any other
scene keeps its lattice, so that "fast" is "balanced" there. Timesteps are whole fractions of 0.04 s.
"""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

from flag_env.physics import validate
from flag_env.physics.calibration import FRAME, calibrate, check_smooth, error_of
from flag_env.physics.effects import AirDrag, AirPressure, Bending, CosineWind, Effect, Gravity, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4
from flag_env.physics.scene import Scene
from flag_env.physics.simulator import Simulator
from flag_env.physics.stability import limited_by, max_timestep, timestep_of
from flag_env.physics.state import Diverged

ACCURACIES = ("fast", "balanced", "reference")
"""The recipes, from the cheapest to the most accurate."""

WIDTH = (Gravity, Structural, Shear, Bending, AirDrag, AirPressure, CosineWind)
"""Effects that are held while a lattice is made coarser."""

SMALLEST = 5
"""Rows and columns below which a lattice is not halved."""

REFERENCE_SHARE = 0.5
"""Share of RK4's step limit that "reference" takes."""

_TRIAL = 0.01
"""Time for which a scene is run to see how fast it is [s]."""


def tuned(scene: Scene, accuracy: str | float, displaced: float = 0.0) -> Scene:
    """See `Scene.tuned`."""
    displaced = validate.number("displaced", displaced, minimum=0.0)
    if isinstance(accuracy, str):
        validate.choice("accuracy", accuracy, ACCURACIES)
        lattice_of = _halved(scene) if accuracy == "fast" else scene
        if accuracy == "reference":
            exact = lattice_of.replace(integrator=RK4(), dtype="float64", timestep="auto")
            limit = max_timestep(exact)
            return on_frames(exact, REFERENCE_SHARE * limit if math.isfinite(limit) else timestep_of(exact))
        quick = lattice_of.replace(integrator=LFAB(), dtype="float32", timestep="auto")
        return on_frames(quick, timestep_of(quick))
    found = calibrate(scene, validate.number("accuracy", accuracy, above=0.0), displaced)
    return scene.replace(integrator=found.integrator, timestep=found.timestep, dtype=found.dtype, allow_unstable=False)


def on_frames(scene: Scene, timestep: float) -> Scene:
    """The scene at this timestep [s], lowered to a whole fraction of 0.04 s, which is the environments' control step too."""
    return scene.replace(timestep=FRAME / max(1, math.ceil(FRAME / timestep - 1e-9)))


def _halved(scene: Scene) -> Scene:
    """The scene with half the particles along and up, if it is a plain cloth; else as it is."""
    old = scene.lattice
    plain = old.layers == 1 and old.dimensions == 3 and isinstance(old.pinned, str)
    if not plain or min(old.rows, old.cols) < SMALLEST or any(type(effect) not in WIDTH for effect in scene.effects):
        return scene
    rows, cols = (old.rows + 1) // 2, (old.cols + 1) // 2
    along, up = old.extent[0] / (cols - 1), old.extent[1] / (rows - 1)
    share = (rows * cols) / old.size
    lattice = dataclasses.replace(old, rows=rows, cols=cols, spacing=(along, up, min(along, up)), mass=old.mass / share)
    finer = min(old.steps[:2])
    effects = tuple(_per_particle(effect, 1.0 / share) for effect in scene.effects)
    return scene.replace(lattice=lattice, effects=effects, perturbation=scene.perturbation * min(along, up) / finer)


def _per_particle(effect: Effect, factor: float) -> Effect:
    """The effect with a force that is given per particle multiplied."""
    if not isinstance(effect, CosineWind):
        return effect
    mean, amplitude = (tuple(factor * entry for entry in value) for value in (effect.mean, effect.amplitude))
    return dataclasses.replace(effect, mean=mean, amplitude=amplitude)


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
        Expected integration error over one second from the scene's own start [m]: RMS over the particles, worst of 25 frames,
        measured as in `flag_env.physics.calibration`; infinite for a scene that diverges, None where it is not known.
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
    """See `Scene.describe`."""
    timestep, limit = timestep_of(scene), max_timestep(scene)
    error, reason = None, ""
    try:
        check_smooth(scene)
        error = error_of(scene, timestep)
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
