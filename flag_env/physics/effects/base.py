"""What every effect offers; `flag_env.physics.compiling` tells of the compiled half."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.lattice import Direction, Family, Lattice

Key = tuple[type["Effect"], str | None]
"""What tells the effects of a scene apart: their kind and their name."""


class LinkGroup(NamedTuple):
    """The links of one effect in a run. Effects that break links, or ask which hold, are handed those of all effects.

    Attributes
    ----------
    key
        The effect that the links belong to.
    directions
        Direction of each family.
    families
        The families, one for each direction.
    weight : (1 or copies, families, particles)
        Factor of each link, by its first particle; zero where there is none, or where it is broken. One row of families serves
        all copies, unless links can break. In the scene's dtype.
    """

    key: Key
    directions: tuple[Direction, ...]
    families: tuple[Family, ...]
    weight: NDArray[Any]


class BindContext(NamedTuple):
    """What an effect sees when it is bound to a run.

    Attributes
    ----------
    lattice
        The particles.
    dtype
        Of the simulation's arrays.
    copies
        Number of copies; state that a copy may change has this leading axis.
    timestep
        [s].
    seed
        Of random effects; copy i draws from the stream (seed, i).
    links
        The links of all effects of the scene.
    breaks
        Whether an effect of the scene may break links.
    """

    lattice: Lattice
    dtype: np.dtype[Any]
    copies: int
    timestep: float
    seed: int
    links: tuple[LinkGroup, ...] = ()
    breaks: bool = False


class LinkTerm(NamedTuple):
    """What one family of links adds to a scene's stiffness and damping at most.

    Attributes
    ----------
    family
        The links.
    stiffness : (particles - offset,)
        Upper bound of each link's stiffness in any pose [N/m].
    viscosity : (particles - offset,)
        Upper bound of each link's damping [N s/m].
    isotropic
        Whether the damping acts along every direction in every pose, not only at most.
    """

    family: Family
    stiffness: NDArray[np.float64]
    viscosity: NDArray[np.float64]
    isotropic: bool = False


class LinearBound(NamedTuple):
    """What an effect adds to a scene's stiffness and damping at most, in every pose: all that a step limit needs to know of it.

    Attributes
    ----------
    links
        Stiffness and damping between particles, by families of links.
    stiffness : (particles,) or None
        Stiffness of each particle against a fixed point, an anchor [N/m]; None: none.
    drag : (particles,) or None
        Damping of each particle against something at rest [N s/m]; None: none.
    isotropic
        Whether `drag` acts along every direction at every velocity, not only at most.
    """

    links: tuple[LinkTerm, ...] = ()
    stiffness: NDArray[np.float64] | None = None
    drag: NDArray[np.float64] | None = None
    isotropic: bool = False


@dataclass(frozen=True)
class Effect:
    """Description of one physical effect: immutable, hashable, picklable; knows nothing of a run.

    Parameters
    ----------
    name
        Tells several effects of one kind in a scene apart; keyword only. None where there is one.

    Attributes
    ----------
    rank
        A scene holds its effects by rank, those of one rank as given: who moves particles last has the last word.
    breaks
        Whether it may break links while a scene runs, which then lose their stiffness and their damping.
    wind_unit
        Unit of its wind's mean and amplitude: "N", a force on every particle, or "m/s", a velocity of the air; its data then has
        a `Oscillation` called `wind`. None: it has no wind.
    scales_with
        Parameters whose common factor is one of the force, while the particles' masses stay; none where the force follows the
        masses themselves; None: not known. From them gradients know what a change of the masses does.
    """

    rank: ClassVar[int] = 0
    breaks: ClassVar[bool] = False
    wind_unit: ClassVar[str | None] = None
    scales_with: ClassVar[tuple[str, ...] | None] = None

    _: KW_ONLY
    name: str | None = None

    def __post_init__(self) -> None:
        if self.name is not None and not (isinstance(self.name, str) and self.name.isidentifier()):
            raise ValueError(f"name must be None or letters, digits and underscores, such as 'halyard', got {self.name!r}")

    @property
    def key(self) -> Key:
        """Kind and name; no two effects of a scene share them."""
        return type(self), self.name

    @property
    def label(self) -> str:
        """Kind and name, as errors and tables show them: "Gravity", or "Attachment 'halyard'"."""
        return type(self).__name__ + (f" {self.name!r}" if self.name else "")

    def check(self, lattice: Lattice) -> None:
        """Raise ValueError if the effect makes no sense on the lattice."""

    def check_wind(self, mean: NDArray[np.float64], amplitude: NDArray[np.float64]) -> None:
        """Raise ValueError if the effect's wind must not have this mean and amplitude (..., 3), in its unit."""

    def bind(self, context: BindContext) -> Any:
        """Arrays and typed scalars for the compiled step, as a NamedTuple whose type carries the hooks."""
        raise NotImplementedError(f"{type(self).__name__} must define bind(self, context)")

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """Upper bounds of the stiffness and the damping that the effect adds, in every pose; `LinearBound()` if it adds none."""
        raise NotImplementedError(f"{type(self).__name__} must define linear_bound(self, lattice)")

    @property
    def smooth(self) -> bool:
        """Whether its force is a function of pose, motion and time that leaves integrators their order of accuracy."""
        return True

    def link_weights(self, lattice: Lattice) -> dict[Direction, tuple[Family, NDArray[np.float64]]] | None:
        """Families of the effect's links by direction, each with its links' factors (particles - offset,); None without links."""
        del lattice
        return None

    def energy(self, lattice: Lattice, positions: NDArray[np.float64], data: Any = None) -> NDArray[np.float64] | None:
        """Potential energy [J], shape (copies,), for positions (copies, particles, 3) [m]; None unless conservative.

        `data` is what `bind` returned, for what has changed during a run, such as broken links; None: nothing has.
        """
        del lattice, positions, data
        return None

    def scaled(self, stiffness: float, viscosity: float) -> Effect:
        """The same effect with its stiffness and viscosity multiplied; unchanged where it has none."""
        del stiffness, viscosity
        return self

    def coarsened(self, share: float) -> Effect | None:
        """The effect on the same cloth made of this share of the particles; None where that is not the same effect."""
        del share
        return None
