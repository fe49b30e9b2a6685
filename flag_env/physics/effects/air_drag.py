"""Linear air drag: F = -c m v, the drag of still air on a slow body.

Parameters: rate c [1/s], the rate at which a particle left alone slows down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects._sums import weighted_dot
from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.lattice import Lattice


@kernel
def _brake(f, v, drag, n):
    for t in range(n):
        f[t] -= drag[t] * v[t]


class AirDragData(NamedTuple):
    """`drag` [N s/m] and `mass` [kg], (particles,) each."""

    drag: NDArray[Any]
    mass: NDArray[Any]

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        """Subtract the drag."""
        for d in range(f.shape[0]):
            _brake(f[d], v[d], data.drag, f.shape[1])

    @staticmethod
    def parameters() -> tuple[str, ...]:
        """What `slopes` are with respect to."""
        return ("rate",)

    @staticmethod
    @jit
    def pull_back(data, copy, x, v, g, dx, dv, effect_work, lag):
        """The drag is linear."""
        for d in range(g.shape[0]):
            _brake(dv[d], g[d], data.drag, g.shape[1])

    @staticmethod
    @jit
    def slopes(data, copy, x, v, g, out, effect_work, lag):
        """By the rate: -m v."""
        for d in range(g.shape[0]):
            out[0] -= weighted_dot(data.mass, v[d], g[d], g.shape[1])


@dataclass(frozen=True)
class AirDrag(Effect):
    """Drag proportional to mass and velocity.

    Parameters
    ----------
    rate
        Decay rate of a free particle's velocity [1/s], >= 0.
    """

    scales_with: ClassVar[tuple[str, ...] | None] = ()

    rate: float = 1.5

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "rate", _validate.number("rate", self.rate, minimum=0.0))

    def drag(self, lattice: Lattice) -> NDArray[np.float64]:
        """Damping of each particle [N s/m], shape (particles,)."""
        return self.rate * lattice.masses

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """The drag, which acts along every direction."""
        return LinearBound(drag=self.drag(lattice), isotropic=True)

    def coarsened(self, share: float) -> AirDrag:
        """A rate is the same for any particles."""
        del share
        return self

    def bind(self, context: BindContext) -> AirDragData:
        """The particles' damping and masses in the scene's dtype."""
        lattice, dtype = context.lattice, context.dtype
        return AirDragData(self.drag(lattice).astype(dtype), lattice.masses.astype(dtype))
