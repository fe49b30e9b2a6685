"""A scene: what is simulated and how, as one immutable value."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from flag_env import _validate
from flag_env.physics.effects import Effect, check_contract
from flag_env.physics.integrators import LFAB, Integrator
from flag_env.physics.lattice import Lattice

DTYPES = ("float64", "float32")

SMALLEST_FLOAT32, LARGEST_FLOAT32 = 1e-15, 1e15
"""Spacings [m] and masses [kg] that float32 can square and divide by."""


@dataclass(frozen=True)
class Scene:
    """A lattice, the effects that act on it, and the way time is stepped. Frozen, hashable, picklable, cheap to make.

    Parameters
    ----------
    lattice
        The particles.
    effects
        The effects, at most one of a kind and a name. Nothing else is simulated. Those that keep things apart go to the end.
    integrator
        The method; default `LFAB()`, of order 2 at one evaluation of the forces a step.
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
    integrator: Integrator = LFAB()  # noqa: RUF009  (immutable)
    timestep: float | str = "auto"
    dtype: str = "float64"
    allow_unstable: bool = False
    perturbation: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.lattice, Lattice):
            raise TypeError(f"lattice must be a Lattice, got {self.lattice!r}")
        object.__setattr__(self, "dtype", _dtype(self.dtype))
        object.__setattr__(self, "effects", _effects(self.effects))
        for effect in self.effects:
            effect.check(self.lattice)
            check_contract(effect, self.lattice, self.dtype)
        if not isinstance(self.integrator, Integrator):
            raise TypeError(f"integrator must be an Integrator, such as integrators.LFAB(), got {self.integrator!r}")
        if not isinstance(self.timestep, str) or self.timestep != "auto":
            if isinstance(self.timestep, str):
                raise ValueError(f"timestep must be a number of seconds or 'auto', got {self.timestep!r}")
            object.__setattr__(self, "timestep", _validate.number("timestep", self.timestep, above=0.0))
        if self.dtype == "float32":
            _fit_float32(self.lattice)
        if not isinstance(self.allow_unstable, bool):
            raise TypeError(f"allow_unstable must be True or False, got {self.allow_unstable!r}")
        object.__setattr__(self, "perturbation", _validate.number("perturbation", self.perturbation, minimum=0.0))

    def replace(self, **changes: Any) -> Scene:
        """A new scene with the given fields changed."""
        return dataclasses.replace(self, **changes)

    def adding(self, *effects: Effect) -> Scene:
        """A new scene with these effects; one takes the place of that of the same kind and name, if there is one."""
        kept = list(self.effects)
        for effect in _effects(effects):
            same = [index for index, present in enumerate(kept) if present.key == effect.key]
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
        stiffness = _validate.number("stiffness", stiffness, minimum=0.0)
        viscosity = _validate.number("viscosity", viscosity, minimum=0.0)
        return self.replace(effects=tuple(effect.scaled(stiffness, viscosity) for effect in self.effects))


def _effects(effects: Iterable[Any]) -> tuple[Effect, ...]:
    if isinstance(effects, Effect):
        effects = (effects,)
    if not isinstance(effects, Iterable):
        raise TypeError(f"effects must hold effects, such as effects.Gravity(), got {effects!r}")
    result = tuple(effects)
    for effect in result:
        if not isinstance(effect, Effect):
            raise TypeError(f"effects must hold effects, such as effects.Gravity(), got {effect!r}")
    labels = [effect.label for effect in result]
    doubled = sorted({label for label in labels if labels.count(label) > 1})
    if doubled:
        raise ValueError(
            f"effects must hold at most one effect of a kind and a name, got several of {', '.join(doubled)}; tell them apart by "
            "name, as in effects.Attachment(..., name='halyard')"
        )
    return tuple(sorted(result, key=lambda effect: effect.rank))


def _fit_float32(lattice: Lattice) -> None:
    """Raise ValueError unless squares and reciprocals of the lattice's numbers stay within float32."""
    taper = lattice.mass * lattice.taper
    for name, value in (("mass", lattice.mass), ("mass * taper", taper), *(("spacing", step) for step in lattice.spacings)):
        if not SMALLEST_FLOAT32 <= value <= LARGEST_FLOAT32:
            raise ValueError(
                f"{name} must be of a magnitude from {SMALLEST_FLOAT32:g} to {LARGEST_FLOAT32:g} in a scene with "
                f"dtype='float32', got {value:g}"
            )


def _dtype(value: Any) -> str:
    try:
        name = np.dtype(value).name
    except TypeError:
        name = str(value)
    return _validate.choice("dtype", name, DTYPES)
