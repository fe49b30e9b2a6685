"""Between the public arrays, (copies, layers, rows, cols, 3) in float64, and the flat rows that the kernels take."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.physics.lattice import Lattice


class Coordinates:
    """The coordinates that a scene holds of each particle, in rows of (copies, coordinates, particles).

    Parameters
    ----------
    lattice
        The particles.
    copies
        Number of copies.
    dtype
        Of the flat rows.
    """

    def __init__(self, lattice: Lattice, copies: int, dtype: np.dtype[Any]) -> None:
        self._lattice, self._copies, self._dtype = lattice, copies, dtype
        self.axes = list(lattice.axes)

    def public(self, flat: NDArray[Any], rest: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Three coordinates of every particle; those that the scene does not hold are zero, or the `rest` positions'."""
        shape = (self._copies, *self._lattice.shape, 3)
        if len(self.axes) == 3:
            return np.array(flat.transpose(0, 2, 1), dtype=np.float64, order="C").reshape(shape)
        ordered = np.zeros(shape) if rest is None else np.tile(rest, (self._copies, 1, 1, 1, 1))
        ordered.reshape(self._copies, -1, 3)[:, :, self.axes] = flat.transpose(0, 2, 1)
        return ordered

    def flat(self, name: str, value: ArrayLike, rest: NDArray[np.float64] | float = 0.0) -> NDArray[np.float64]:
        """Rows from a public array, with or without its copies; ValueError, naming the argument, unless the scene can hold it."""
        lattice = self._lattice
        shape = (*lattice.shape, 3)
        checked = _validate.array(name, value, shape, (self._copies, *shape))
        if (largest := np.abs(checked).max()) > np.finfo(self._dtype).max:
            raise ValueError(f"{name} must fit the scene's {self._dtype}, got a magnitude of {largest:g}")
        self.check(name, checked, rest)
        rows = checked.reshape(-1, lattice.size, 3).transpose(0, 2, 1)[:, self.axes]
        return np.broadcast_to(rows, (self._copies, len(self.axes), lattice.size))

    def check(self, name: str, points: NDArray[np.float64], rest: NDArray[np.float64] | float) -> None:
        """Raise ValueError, naming the argument, unless points (..., 3) are at rest along coordinates that the scene lacks."""
        absent = [axis for axis in range(3) if axis not in self.axes]
        if absent and (points - rest)[..., absent].any():
            names = " and ".join("xyz"[axis] for axis in absent)
            raise ValueError(f"{name} must keep {names} as at rest: the scene has dimensions={len(self.axes)}")
