"""A scene: what is simulated and how, as one immutable value."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flag_env.physics import validate
from flag_env.physics.effects.base import Effect
from flag_env.physics.integrators.base import Integrator
from flag_env.physics.integrators.leapfrog import Leapfrog
from flag_env.physics.lattice import Lattice

if TYPE_CHECKING:
    from flag_env.physics.tuning import Description

DTYPES = ("float64", "float32")


@dataclass(frozen=True)
class Scene:
    """A lattice, the effects that act on it, and the way time is stepped. Frozen, hashable, picklable, cheap to make.

    Parameters
    ----------
    lattice
        The particles.
    effects
        The effects, at most one of a kind. Nothing else is simulated. Those that keep things apart go to the end.
    integrator
        The method; `Leapfrog()` unless told.
    timestep
        Seconds, or "auto": 0.9 of the step limit.
    dtype
        "float64" or "float32": the arithmetic of the simulation.
    allow_unstable
        Whether a timestep above the limit is accepted when the scene is simulated.
    perturbation
        Standard deviation of a seeded displacement of every free particle along y at the start [m]. A perfectly plane cloth
        under in-plane forces would stay plane for ever.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, its value and what is allowed.
    """

    lattice: Lattice
    effects: tuple[Effect, ...] = ()
    integrator: Integrator = Leapfrog()  # noqa: RUF009  (immutable)
    timestep: float | str = "auto"
    dtype: str = "float64"
    allow_unstable: bool = False
    perturbation: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.lattice, Lattice):
            raise TypeError(f"lattice must be a Lattice, got {self.lattice!r}")
        object.__setattr__(self, "effects", _effects(self.effects))
        for effect in self.effects:
            effect.check(self.lattice)
        if not isinstance(self.integrator, Integrator):
            raise TypeError(f"integrator must be an Integrator, such as integrators.Leapfrog(), got {self.integrator!r}")
        if self.timestep != "auto":
            if isinstance(self.timestep, str):
                raise ValueError(f"timestep must be a number of seconds or 'auto', got {self.timestep!r}")
            object.__setattr__(self, "timestep", validate.number("timestep", self.timestep, above=0.0))
        object.__setattr__(self, "dtype", _dtype(self.dtype))
        if not isinstance(self.allow_unstable, bool):
            raise TypeError(f"allow_unstable must be True or False, got {self.allow_unstable!r}")
        object.__setattr__(self, "perturbation", validate.number("perturbation", self.perturbation, minimum=0.0))

    def replace(self, **changes: Any) -> Scene:
        """A new scene with the given fields changed."""
        return dataclasses.replace(self, **changes)

    def adding(self, *effects: Effect) -> Scene:
        """A new scene with these effects; one of a kind that is there already takes its place."""
        kept = list(self.effects)
        for effect in _effects(effects):
            same = [index for index, present in enumerate(kept) if type(present) is type(effect)]
            if same:
                kept[same[0]] = effect
            else:
                kept.append(effect)
        return self.replace(effects=tuple(kept))

    def without(self, *kinds: type[Effect]) -> Scene:
        """A new scene without the effects of these kinds."""
        for kind in kinds:
            if not isinstance(kind, type) or not issubclass(kind, Effect):
                raise TypeError(f"kinds must be effect classes, such as effects.Shear, got {kind!r}")
        return self.replace(effects=tuple(effect for effect in self.effects if not isinstance(effect, kinds)))

    def scaled(self, stiffness: float = 1.0, viscosity: float = 1.0) -> Scene:
        """A new scene with the stiffness and viscosity of every link multiplied by these factors (>= 0)."""
        stiffness = validate.number("stiffness", stiffness, minimum=0.0)
        viscosity = validate.number("viscosity", viscosity, minimum=0.0)
        return self.replace(effects=tuple(effect.scaled(stiffness, viscosity) for effect in self.effects))

    def tuned(self, accuracy: str | float, displaced: float = 0.0) -> Scene:
        """A new scene, as cheap as may be at an accuracy.

        Parameters
        ----------
        accuracy
            A number [m], > 0: integrator, timestep and dtype are the cheapest whose integration error stays below it over the
            first second (RMS over the particles), found by a calibration of a second or a few that is kept on disk. Or a recipe:
            "fast" (a plain cloth on a lattice half as fine), "balanced" or "reference"; see `flag_env.physics.tuning`.
        displaced
            RMS displacement of the particles, each by itself, in starts that a number is to cover too [m]; 0: the scene's own
            start alone. Other poses set by hand, velocities and a wilder mast or wind may cost more. Recipes take no notice.

        Raises
        ------
        TypeError, ValueError
            If `accuracy` is neither; if a number is out of reach, or the scene holds an effect, such as a collision, for which
            integrators have no order of accuracy.
        """
        from flag_env.physics import tuning  # it runs the scene, which a scene alone cannot

        return tuning.tuned(self, accuracy, displaced)

    def describe(self) -> Description:
        """Expected integration error, cost of a simulated second, step limit and what sets it; `print` it. Runs the scene."""
        from flag_env.physics import tuning

        return tuning.describe(self)


def _effects(effects: Iterable[Any]) -> tuple[Effect, ...]:
    if isinstance(effects, Effect):
        effects = (effects,)
    if not isinstance(effects, Iterable):
        raise TypeError(f"effects must hold effects, such as effects.Gravity(), got {effects!r}")
    result = tuple(effects)
    for effect in result:
        if not isinstance(effect, Effect):
            raise TypeError(f"effects must hold effects, such as effects.Gravity(), got {effect!r}")
    kinds = [type(effect).__name__ for effect in result]
    doubled = sorted({kind for kind in kinds if kinds.count(kind) > 1})
    if doubled:
        raise ValueError(f"effects must hold at most one effect of a kind, got several of {', '.join(doubled)}")
    return tuple(sorted(result, key=lambda effect: effect.rank))


def _dtype(value: Any) -> str:
    try:
        name = np.dtype(value).name
    except TypeError:
        name = str(value)
    return validate.choice("dtype", name, DTYPES)
