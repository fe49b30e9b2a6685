"""Springs and dampers along families of links: what `Structural`, `Shear`, `Bending` and `CrossLayer` share.

Force on the first particle of a link, the opposite on the second (the report's, section "modelling"):

    isotropic:  F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)]
    axial:      F = w [k (1 - l/d) + z ((x2 - x1).(v2 - v1)) / d^2] (x2 - x1)

k stiffness [N/m], z viscosity [N s/m], l rest length [m], d length now [m], w the link's weight: 1, or the mean taper of its two
ends. On a rope, in one dimension, F = w [k (z2 - z1) + z (w2 - w1)]. Both dampers keep linear momentum; the isotropic one also
brakes rigid rotation, the axial one keeps angular momentum. Without viscosity no velocity is read. A link of no length has no
direction and exerts no elastic force.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.effects.base import BindContext, Effect, LinearBound, LinkTerm
from flag_env.physics.effects.links.kernels import Springs
from flag_env.physics.effects.links.links_1d import Damped1, Elastic1
from flag_env.physics.effects.links.links_2d import Axial2, Elastic2, Isotropic2
from flag_env.physics.effects.links.links_3d import Axial3, Elastic3, Isotropic3
from flag_env.physics.lattice import Direction, Family, Lattice

TINY = 1e-30
"""Added to d^2 [m^2]: keeps a link of no length finite, and changes no bit of any other."""


_KINDS = {
    (3, "none"): Elastic3,
    (3, "isotropic"): Isotropic3,
    (3, "axial"): Axial3,
    (2, "none"): Elastic2,
    (2, "isotropic"): Isotropic2,
    (2, "axial"): Axial2,
    (1, "none"): Elastic1,
    (1, "isotropic"): Damped1,
    (1, "axial"): Damped1,
}


@dataclass(frozen=True)
class LinkEffect(Effect):
    """Springs and dampers along the link directions `directions`.

    Parameters
    ----------
    stiffness
        Of every link [N/m], >= 0.
    viscosity
        Of every link [N s/m], >= 0.
    damping
        "isotropic" (the report's) or "axial".
    tapered
        Whether stiffness and viscosity follow the mass taper, as in the report's program: a link takes the mean of its ends.
    """

    directions: ClassVar[tuple[Direction, ...]] = ()
    scales_with: ClassVar[tuple[str, ...] | None] = ("stiffness", "viscosity")

    stiffness: float = 0.0
    viscosity: float = 0.0
    damping: str = "isotropic"
    tapered: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "stiffness", _validate.number("stiffness", self.stiffness, minimum=0.0))
        object.__setattr__(self, "viscosity", _validate.number("viscosity", self.viscosity, minimum=0.0))
        _validate.choice("damping", self.damping, ("isotropic", "axial"))
        object.__setattr__(self, "tapered", _validate.boolean("tapered", self.tapered))

    def families(self, lattice: Lattice) -> tuple[Family, ...]:
        """The link families that the effect acts along."""
        return lattice.families(*self.directions)

    def bind(self, context: BindContext) -> Any:
        """Weights and constants of every family, in the scene's dtype."""
        lattice, dtype = context.lattice, context.dtype
        (group,) = (group for group in context.links if group.key == self.key)
        number = dtype.type
        arrays = Springs(
            np.array([family.offset for family in group.families], np.int64),
            group.weight,
            number(self.stiffness),
            np.array([self.stiffness * family.length for family in group.families], dtype),
            np.array([family.length if lattice.dimensions > 1 else 0.0 for family in group.families], dtype),
            number(TINY),
        )
        if self.viscosity == 0:
            return _KINDS[lattice.dimensions, "none"](*arrays)
        return _KINDS[lattice.dimensions, self.damping](*arrays, number(self.viscosity))

    def link_weights(self, lattice: Lattice) -> dict[Direction, tuple[Family, NDArray[np.float64]]]:
        """The links by direction, each link with the taper of its ends or 1."""
        families = {direction: lattice.families(direction) for direction in self.directions}
        return {direction: (family, family.weight(self.tapered)) for direction, found in families.items() for family in found}

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """Since 1 - l/d <= 1, no pose makes a spring stiffer than k, and an axial damper never exceeds an isotropic one."""
        everywhere = self.damping == "isotropic" or lattice.dimensions == 1
        weights = ((family, family.weight(self.tapered)) for family in self.families(lattice))
        return LinearBound(
            tuple(LinkTerm(family, self.stiffness * weight, self.viscosity * weight, everywhere) for family, weight in weights)
        )

    def energy(self, lattice: Lattice, positions: NDArray[np.float64], data: Any = None) -> NDArray[np.float64]:
        """Sum of w k (d - l)^2 / 2 over the links that hold, or on a rope of w k (z2 - z1)^2 / 2 [J], shape (copies,)."""
        intact = None if data is None else data.weight != 0
        total = np.zeros(len(positions))
        for j, family in enumerate(self.families(lattice)):
            difference = positions[:, family.offset :] - positions[:, : positions.shape[1] - family.offset]
            length = np.linalg.norm(difference, axis=-1)
            stretch = difference[..., 2] if lattice.dimensions == 1 else length - family.length
            weight = family.weight(self.tapered) * (True if intact is None else intact[:, j, : length.shape[1]])
            total += 0.5 * self.stiffness * (weight * stretch**2).sum(axis=-1)
        return total

    def scaled(self, stiffness: float, viscosity: float) -> LinkEffect:
        """The same links with stiffness and viscosity multiplied."""
        return replace(self, stiffness=self.stiffness * stiffness, viscosity=self.viscosity * viscosity)
