"""Gravity: F = (0, 0, -m g).

Parameters: acceleration g [m/s^2]; tapered: whether the weight follows the mass taper, as weight does. The report's program
pulls every free particle with the same force whatever its mass: tapered=False, F = -(mast-side mass) g.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects._sums import dot
from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.lattice import Lattice


@kernel
def _subtract(f, weight, n):
    for t in range(n):
        f[t] -= weight[t]


class GravityData(NamedTuple):
    """`weight` (particles,) [N], and the mass that is pulled, `pulled` (particles,) [kg]."""

    weight: NDArray[Any]
    pulled: NDArray[Any]

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        """Subtract the weight from the last coordinate, z."""
        _subtract(f[f.shape[0] - 1], data.weight, f.shape[1])

    @staticmethod
    def parameters() -> tuple[str, ...]:
        """What `slopes` are with respect to."""
        return ("acceleration",)

    @staticmethod
    @jit
    def pull_back(data, copy, x, v, g, dx, dv, effect_work, lag):
        """Nothing: the force is constant."""

    @staticmethod
    @jit
    def slopes(data, copy, x, v, g, out, effect_work, lag):
        """By the acceleration: -m."""
        out[0] -= dot(data.pulled, g[g.shape[0] - 1], g.shape[1])


@dataclass(frozen=True)
class Gravity(Effect):
    """Weight, along -z.

    Parameters
    ----------
    acceleration
        g [m/s^2]; negative pulls upwards.
    tapered
        Whether the force follows the mass taper (True) or is that of a mast-side particle everywhere (False, the report's).
    """

    scales_with: ClassVar[tuple[str, ...] | None] = ()

    acceleration: float = 9.81
    tapered: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "acceleration", _validate.number("acceleration", self.acceleration))
        object.__setattr__(self, "tapered", _validate.boolean("tapered", self.tapered))

    def weight(self, lattice: Lattice) -> NDArray[np.float64]:
        """Downward force on each particle [N], shape (particles,)."""
        return self.acceleration * self._pulled(lattice)

    def _pulled(self, lattice: Lattice) -> NDArray[np.float64]:
        """Mass that is pulled at each particle [kg]."""
        return lattice.masses if self.tapered else np.full(lattice.size, lattice.mass)

    def bind(self, context: BindContext) -> GravityData:
        """The particles' weights in the scene's dtype."""
        lattice, dtype = context.lattice, context.dtype
        return GravityData(self.weight(lattice).astype(dtype), self._pulled(lattice).astype(dtype))

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """A constant force adds nothing."""
        del lattice
        return LinearBound()

    def coarsened(self, share: float) -> Gravity:
        """An acceleration is the same for any particles."""
        del share
        return self

    def energy(self, lattice: Lattice, positions: NDArray[np.float64], data: Any = None) -> NDArray[np.float64]:
        """Sum of m g z over the free particles [J], shape (copies,)."""
        del data
        return positions[:, :, 2] @ np.where(lattice.fixed, 0.0, self.weight(lattice))
