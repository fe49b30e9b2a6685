"""Linear air drag: F = -c m v, the drag of still air on a slow body.

Parameters: rate c [1/s], the rate at which a particle left alone slows down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import validate
from flag_env.physics.effects.base import Effect, Setting
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Lattice


@kernel
def _brake(f, v, drag, n):
    for t in range(n):
        f[t] -= drag[t] * v[t]


class BoundAirDrag(NamedTuple):
    """`drag` (particles,) [N s/m]."""

    drag: NDArray[Any]

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Subtract the drag."""
        for d in range(f.shape[0]):
            _brake(f[d], v[d], bound.drag, f.shape[1])


@dataclass(frozen=True)
class AirDrag(Effect):
    """Drag proportional to mass and velocity.

    Parameters
    ----------
    rate
        Decay rate of a free particle's velocity [1/s], >= 0.
    """

    lasting: ClassVar[bool] = True

    rate: float = 1.5

    def __post_init__(self) -> None:
        object.__setattr__(self, "rate", validate.number("rate", self.rate, minimum=0.0))

    def drag(self, lattice: Lattice) -> NDArray[np.float64]:
        """Damping of each particle [N s/m], shape (particles,)."""
        return self.rate * lattice.masses

    def bind(self, setting: Setting) -> BoundAirDrag:
        """The particles' damping in the scene's dtype."""
        return BoundAirDrag(self.drag(setting.lattice).astype(setting.dtype))
