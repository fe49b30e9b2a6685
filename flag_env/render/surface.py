"""A cloth lattice as a finer, coloured surface: smooth, or where it is torn, every cell for itself."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CLOTH", "Palette", "Surface", "cells_of", "surface_for"]

Array = NDArray[np.float64]

# Drawn cells of a flag: about 5 pixels each in a 480x480 picture. Fewer look faceted, more take longer.
CELLS = 480
MOST_CELLS = 4000  # finer lattices are sampled down to this
NARROWING = 1.1  # folds run up the cloth more than along it, so cells are narrower along


class Palette(NamedTuple):
    """Colours of one flag, RGB from 0 to 1: two fields, the cross between them, the heading at the mast."""

    first: tuple[float, float, float]
    second: tuple[float, float, float]
    cross: tuple[float, float, float]
    heading: tuple[float, float, float]


CLOTH = Palette((0.890, 0.270, 0.235), (0.965, 0.640, 0.200), (0.985, 0.950, 0.885), (0.930, 0.905, 0.850))


class Surface:
    """Interpolation from the lattice to drawn vertices, and the pattern of the drawn cells.

    Attributes
    ----------
        outline: vertex numbers around the first layer's edge, closed, shape (k,).
        albedo: colour of each cell's two faces, RGB from 0 to 1, shape (2, n, 3); the first faces -y.
    """

    def __init__(self, layers: int, rows: int, cols: int, palette: Palette, torn: bool) -> None:
        """Prepare the surface of a lattice with at least two rows and two columns.

        If it is `torn`, each of the lattice's cells is as many drawn cells, and their vertices depend on its corners alone.
        """
        down, along = _resolution(layers, rows, cols)
        if torn:
            down, along = (max(1, round(n / cells)) * cells for n, cells in ((down, rows - 1), (along, cols - 1)))
        interpolation = _linear if torn else _catmull_rom
        self._repeats = down // (rows - 1), along // (cols - 1)
        self._down = interpolation(rows, down + 1)
        self._along = np.ascontiguousarray(interpolation(cols, along + 1).T)
        edge = np.arange((down + 1) * (along + 1)).reshape(down + 1, along + 1)
        self.outline = np.concatenate([edge[0], edge[1:, -1], edge[-1, -2::-1], edge[-2::-1, 0]])
        pattern = np.broadcast_to(_pattern(down, along, palette), (layers, down, along, 3)).reshape(-1, 3)
        self.albedo = np.stack([pattern, 0.90 * pattern + 0.015])

    def vertices(self, positions: Array) -> Array:
        """Return the drawn vertices of a lattice.

        Args:
            positions: particle positions [m], shape (layers, rows, cols, 3).

        Returns
        -------
            Vertices [m], shape (layers, up, along, 3).
        """
        fine = self._down @ np.moveaxis(positions, -1, 0) @ self._along
        return np.ascontiguousarray(np.moveaxis(fine, 0, -1))

    def cells(self, intact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which drawn cells of a torn surface are cloth, shape (layers, up, along), from those of its lattice."""
        return intact.repeat(self._repeats[0], axis=1).repeat(self._repeats[1], axis=2)


def cells_of(grid: Array) -> Array:
    """Return the corners, anticlockwise seen from -y, shape (n, 4, k), of a grid's cells.

    Args:
        grid: vertices, shape (layers, up, along, k).
    """
    layers, up, along, size = grid.shape
    corners = np.empty((layers, up - 1, along - 1, 4, size))
    corners[..., 0, :], corners[..., 1, :] = grid[:, :-1, :-1], grid[:, :-1, 1:]
    corners[..., 2, :], corners[..., 3, :] = grid[:, 1:, 1:], grid[:, 1:, :-1]
    return corners.reshape(-1, 4, size)


@lru_cache(maxsize=16)
def surface_for(layers: int, rows: int, cols: int, palette: Palette = CLOTH, torn: bool = False) -> Surface:
    """Return the surface of a lattice, made once per shape."""
    return Surface(layers, rows, cols, palette, torn)


def _resolution(layers: int, rows: int, cols: int) -> tuple[int, int]:
    """Return how many cells are drawn up and along one layer."""
    own = (rows - 1) * (cols - 1)
    factor = np.sqrt(CELLS * (1.0 + 0.5 * (layers - 1)) / layers / own)
    most = min(1.0, np.sqrt(MOST_CELLS / layers / own))
    down = round((rows - 1) * max(factor / NARROWING, most))
    along = round((cols - 1) * max(factor * NARROWING, most))
    return max(1, down), max(1, along)


def _linear(count: int, samples: int) -> Array:
    """Return the matrix (samples, count) of linear interpolation between equally spaced values."""
    at = np.linspace(0.0, count - 1.0, samples)
    return np.asarray(np.maximum(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0))


def _catmull_rom(count: int, samples: int) -> Array:
    """Return the matrix (samples, count) of Catmull-Rom interpolation between equally spaced values."""
    at = np.linspace(0.0, count - 1.0, samples)
    left = np.clip(np.floor(at).astype(int), 0, count - 2)
    t = at - left
    weights = (
        -0.5 * t + t**2 - 0.5 * t**3,
        1.0 - 2.5 * t**2 + 1.5 * t**3,
        0.5 * t + 2.0 * t**2 - 1.5 * t**3,
        -0.5 * t**2 + 0.5 * t**3,
    )
    padded = np.zeros((samples, count + 2))
    for k, weight in enumerate(weights):
        padded[np.arange(samples), left + k] += weight
    matrix = padded[:, 1:-1].copy()
    # The values beyond both ends go on linearly.
    matrix[:, 0] += 2.0 * padded[:, 0]
    matrix[:, 1] -= padded[:, 0]
    matrix[:, -1] += 2.0 * padded[:, -1]
    matrix[:, -2] -= padded[:, -1]
    return matrix


def _pattern(down: int, along: int, palette: Palette) -> Array:
    """Return the cells' colours, shape (down, along, 3): quarters parted by a cross off the middle."""
    v = ((np.arange(down) + 0.5) / down - 0.5)[:, None]
    u = ((np.arange(along) + 0.5) / along)[None, :]
    first, second, cross, heading = (np.array(color) for color in palette)
    quarter = ((v > 0.0) == (u < 0.38))[..., None]
    colors = np.where(quarter, first, second)
    on_cross = (np.abs(v) < 0.085) | (np.abs(u - 0.38) < 0.085 * 2.0 / 3.0)
    colors = np.where(on_cross[..., None], cross, colors)
    colors = np.where(np.broadcast_to(u < 0.035, (down, along))[..., None], heading, colors)
    # A faint weave makes the lattice's directions readable on plain fields.
    weave = ((np.arange(down)[:, None] // 2 + np.arange(along)[None, :] // 4) % 2)[..., None]
    return np.asarray(colors * (1.0 - 0.035 * weave))
