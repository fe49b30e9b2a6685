"""The step limit of a scene, known before it runs.

Matrices K and Z bound the stiffness and the damping of every pose (`SceneSpectrum`), so an integrator's limit for the
linear problem M x'' + Z x' + K x = 0 is safe for the nonlinear flag too.
"""

from __future__ import annotations

import math
from functools import lru_cache

from flag_env.physics.effects import Effect
from flag_env.physics.integrators import DAMPED, Integrator
from flag_env.physics.lattice import Lattice
from flag_env.physics.limits.spectrum import SceneSpectrum
from flag_env.physics.scene import Scene

AUTO = 0.9
"""Share of the limit, or of the largest useful step, that `timestep="auto"` takes."""

UNLIMITED = 1e-3
"""Automatic timestep where nothing limits it [s]: a scene without springs or damping."""

_LOWERED = 0.99
"""Factor by which a part of a scene is lowered to see its share in the step limit."""


@lru_cache(maxsize=256)
def _limit(lattice: Lattice, effects: tuple[Effect, ...], integrator: Integrator) -> float:
    return math.inf if lattice.fixed.all() else integrator.limit(SceneSpectrum(lattice, effects))


@lru_cache(maxsize=256)
def _useful(lattice: Lattice, effects: tuple[Effect, ...], integrator: Integrator) -> float:
    return math.inf if lattice.fixed.all() else integrator.useful(SceneSpectrum(lattice, effects))


@lru_cache(maxsize=256)
def _share(lattice: Lattice, effects: tuple[Effect, ...], integrator: Integrator) -> float:
    """Share of the limit that "auto" takes: less where a method may heat undamped cloth that turns and stretches."""
    useful = _useful(lattice, effects, integrator)
    if integrator.undamped_share >= AUTO or not math.isfinite(useful):
        return AUTO
    wanted = DAMPED * AUTO * useful
    damped = SceneSpectrum(lattice, effects).damped_step(stop_above=wanted) >= wanted
    return AUTO if damped else integrator.undamped_share


def max_timestep(scene: Scene) -> float:
    """Largest timestep [s] at which no pose of the scene makes its integrator unstable; infinite where nothing limits it.

    Source: the report's stability analysis, K + 2 Z < 4, carried over to the lattice; see `Leapfrog`.
    """
    return _limit(scene.lattice, scene.effects, scene.integrator)


def forget_limits() -> None:
    """Forget the limits that have been found: the next is computed anew."""
    _limit.cache_clear()
    _useful.cache_clear()
    _share.cache_clear()


def limited_by(scene: Scene) -> str:
    """What sets the step limit, such as "the stiffness of Shear": the part of the scene with the largest share in its top mode.

    By first-order perturbation a share, v' K_e v of an effect e in the top mode v, is how much the limit rises when that part
    alone is lowered a little; this holds for every integrator's limit.
    """
    rises: dict[str, float] = {}
    for effect in scene.effects:
        bound = effect.linear_bound(scene.lattice)
        stiff, damped = any(term.stiffness.any() for term in bound.links), any(term.viscosity.any() for term in bound.links)
        present = {"stiffness": stiff or bound.stiffness is not None, "damping": damped or bound.drag is not None}
        for part, scales in (("stiffness", (_LOWERED, 1.0)), ("damping", (1.0, _LOWERED))):
            if not present[part]:
                continue
            spectrum = SceneSpectrum(scene.lattice, scene.effects, {effect.key: scales})
            rises[f"the {part} of {effect.label}"] = scene.integrator.limit(spectrum)
    return max(rises, key=rises.__getitem__)


def _undamped(scene: Scene) -> str:
    """Effects of elastic links that are not damped along every direction."""
    terms = [(effect.label, term) for effect in scene.effects for term in effect.linear_bound(scene.lattice).links]
    bare = [name for name, term in terms if term.stiffness.any() and not (term.isotropic and term.viscosity.any())]
    names = list(dict.fromkeys(bare))
    return f" ({', '.join(names)})" if names else ""


def timestep_of(scene: Scene) -> float:
    """The scene's timestep [s], "auto" resolved.

    Raises
    ------
    ValueError
        If it is above the limit and the scene does not allow that.
    """
    name, limit = type(scene.integrator).__name__, max_timestep(scene)
    if limit == 0.0 and (isinstance(scene.timestep, str) or not scene.allow_unstable):
        raise ValueError(
            f"integrator {name} is unstable at every timestep on this scene: some motion is elastic but not damped"
            f"{_undamped(scene)}; take another "
            "one, damp all links isotropically, or set a timestep and allow_unstable=True"
        )
    if isinstance(scene.timestep, str):
        useful = _useful(scene.lattice, scene.effects, scene.integrator)
        share = _share(scene.lattice, scene.effects, scene.integrator)
        return share * useful if math.isfinite(useful) else UNLIMITED
    if scene.timestep > limit and not scene.allow_unstable:
        setter = limited_by(scene)
        raise ValueError(
            f"timestep must not exceed the scene's limit of {limit:.6g} s for {name}, set by {setter}, got "
            f"{scene.timestep:.6g} s; take a smaller one or 'auto', lower {setter}, or set allow_unstable=True"
        )
    return scene.timestep


def scaled(scene: Scene, timestep: float, stiffness: float, viscosity: float) -> Scene:
    """The scene with its links scaled while it runs at `timestep` [s].

    Raises
    ------
    ValueError
        If that timestep exceeds the limit of the scaled scene.
    """
    changed = scene.scaled(stiffness, viscosity)
    limit = max_timestep(changed)
    if timestep > limit and not changed.allow_unstable:
        raise ValueError(
            f"stiffness_scale = {stiffness:g} and viscosity_scale = {viscosity:g} must keep the step limit above the timestep of "
            f"{timestep:.6g} s; they lower it to {limit:.6g} s, set by {limited_by(changed)}; scale it less, or make the "
            "simulator with a smaller timestep"
        )
    return changed
