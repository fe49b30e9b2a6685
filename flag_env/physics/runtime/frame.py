"""What is read out of a run again and again, in the same memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.lattice import Lattice


class Frame:
    """Positions and velocities of all copies of a scene, at the same instant.

    Parameters
    ----------
    lattice
        The scene's.
    copies
        Number of copies.

    Attributes
    ----------
    x, v : (copies, 3 particles)
        Positions [m], at rest to begin with, and velocities [m/s]; three entries a particle.
    shape
        (copies, layers, rows, cols, 3).
    """

    __slots__ = ("shape", "v", "x")

    def __init__(self, lattice: Lattice, copies: int) -> None:
        self.shape = (copies, *lattice.shape, 3)
        self.x = np.tile(lattice.rest_positions.reshape(1, -1), (copies, 1))
        self.v = np.zeros_like(self.x)

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions [m], shape (copies, layers, rows, cols, 3); the next reading writes over them."""
        return self.x.reshape(self.shape)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """Velocities [m/s], shaped alike; the next reading writes over them."""
        return self.v.reshape(self.shape)
