"""What every effect offers; see `flag_env.physics.compose` for the compiled half."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.lattice import Family, Lattice


class Setting(NamedTuple):
    """What an effect is bound to.

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
    bound
        The effects bound before this one, by their class; those with `binds_last` see all the others.
    """

    lattice: Lattice
    dtype: np.dtype[Any]
    copies: int
    timestep: float
    seed: int
    bound: dict[type[Effect], Any]


class LinkTerm(NamedTuple):
    """What one family of links adds to a scene's stiffness and damping, for the step limit.

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


@dataclass(frozen=True)
class Effect:
    """Description of one physical effect: immutable, hashable, picklable; knows nothing of a run.

    Attributes
    ----------
    binds_last
        Whether it acts on the arrays of other effects, and so is bound after them.
    rank
        A scene holds its effects by rank, those of one rank as given: who moves particles last has the last word.
    breaks
        Whether it may break links while a scene runs, which then lose their stiffness and their damping.
    lasting
        Whether its `drag` acts along every direction at every velocity, not only at most.
    """

    binds_last: ClassVar[bool] = False
    breaks: ClassVar[bool] = False
    lasting: ClassVar[bool] = False
    rank: ClassVar[int] = 0

    def check(self, lattice: Lattice) -> None:
        """Raise ValueError if the effect makes no sense on the lattice."""

    def bind(self, setting: Setting) -> Any:
        """Arrays and typed scalars for the compiled step, as a NamedTuple whose type carries the kernels."""
        raise NotImplementedError(f"{type(self).__name__} must define bind(setting)")

    @property
    def smooth(self) -> bool:
        """Whether its force is a function of pose, motion and time that leaves integrators their order of accuracy."""
        return True

    def link_terms(self, lattice: Lattice) -> tuple[LinkTerm, ...]:
        """Bounds of the effect's link stiffness and damping; empty for effects without links."""
        del lattice
        return ()

    def drag(self, lattice: Lattice) -> NDArray[np.float64] | None:
        """Upper bound of each particle's damping against still air [N s/m], shape (particles,), or None."""
        del lattice
        return None

    def energy(self, lattice: Lattice, positions: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Potential energy [J], shape (copies,), for positions (copies, particles, 3) [m]; None unless conservative."""
        del lattice, positions
        return None

    def scaled(self, stiffness: float, viscosity: float) -> Effect:
        """The same effect with its stiffness and viscosity multiplied; unchanged where it has none."""
        del stiffness, viscosity
        return self
