"""A cloth lattice as a finer, coloured surface: smooth, or where it is torn, every cell for itself."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flag_env.render.shading import cloth_light
from flag_env.render.style import DEFAULT_STYLE, Palette, Style

__all__ = ["Surface", "cells_of", "surface_for"]

Array = NDArray[np.float64]

# Drawn cells of a flag: about 7 pixels each in a 480x480 picture. Fewer have angular outlines, more take longer.
CELLS = 360
TEXTURED_CELLS = 3000
MOST_CELLS = 4000  # finer lattices are sampled down to this
NARROWING = 1.1  # folds run up the cloth more than along it, so cells are narrower along


_HEADING, _MIDDLE, _HALF = 0.035, 0.38, 0.085  # of the pattern: heading, middle of the cross, half its width
_ACROSS = (0.5 - _HALF, 0.5 + _HALF)
_UPWARDS = (_HEADING, _MIDDLE - 2.0 / 3.0 * _HALF, _MIDDLE + 2.0 / 3.0 * _HALF)


class Surface:
    """Interpolation from the lattice to drawn vertices, and the pattern of the drawn cells.

    Attributes
    ----------
        outline: vertex numbers around the first layer's edge, closed, shape (k,).
        albedo: colour of each cell's two faces, RGB from 0 to 1, shape (2, n, 3); the first faces -y.
    """

    def __init__(self, layers: int, rows: int, cols: int, style: Style, torn: bool) -> None:
        """Prepare the surface of a lattice with at least two rows and two columns.

        If it is `torn`, each of the lattice's cells is as many drawn cells, and their vertices depend on its corners alone.
        """
        down, along = _resolution(layers, rows, cols, CELLS if style.texture is None else TEXTURED_CELLS)
        if torn:
            down, along = (max(1, round(n / cells)) * cells for n, cells in ((down, rows - 1), (along, cols - 1)))
        self._torn, self._repeats = torn, (down // (rows - 1), along // (cols - 1))
        plain = torn or style.texture is not None
        v, u = _places(down, () if plain else _ACROSS), _places(along, () if plain else _UPWARDS)
        down, along = len(v) - 1, len(u) - 1
        self._down, self._rise = (_linear if torn else _catmull_rom)(rows, v)
        self._along, self._blend = (np.ascontiguousarray(part.T) for part in (_linear if torn else _catmull_rom)(cols, u))
        edge = np.arange((down + 1) * (along + 1)).reshape(down + 1, along + 1)
        self.outline = np.concatenate([edge[0], edge[1:, -1], edge[-1, -2::-1], edge[-2::-1, 0]])
        texture = style.texture
        drawn = _pattern(v, u, style.palette) if texture is None else _sampled(np.asarray(texture), down, along)
        pattern = np.broadcast_to(drawn, (layers, down, along, 3)).reshape(-1, 3)
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

    def light(self, positions: Array, vertices: Array, forward: Array) -> Array:
        """Return the light at the corners of the drawn cells, shape (n, 4, 2, 4): see `shading.cloth_light`.

        Normals are those of the smooth surface, by its slopes at each vertex; a torn one is flat within each cell.

        Args:
            positions: particle positions [m], shape (layers, rows, cols, 3).
            vertices: what `vertices` returns for them.
            forward: unit vector from the eye into the picture, shape (3,).
        """
        if self._torn:
            along = (vertices[:, 1:, 1:] - vertices[:, 1:, :-1] + vertices[:, :-1, 1:] - vertices[:, :-1, :-1]).reshape(-1, 3)
            up = (vertices[:, 1:, 1:] - vertices[:, :-1, 1:] + vertices[:, 1:, :-1] - vertices[:, :-1, :-1]).reshape(-1, 3)
            return np.repeat(cloth_light(along.T, up.T, forward)[:, None], 4, axis=1)
        grid = np.moveaxis(positions, -1, 0)
        light = cloth_light(self._down @ grid @ self._blend, self._rise @ grid @ self._along, forward)
        return cells_of(light.reshape(*light.shape[:3], 8)).reshape(-1, 4, 2, 4)

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
def surface_for(layers: int, rows: int, cols: int, style: Style = DEFAULT_STYLE, torn: bool = False) -> Surface:
    """Return the surface of a lattice, made once per shape and style."""
    return Surface(layers, rows, cols, style, torn)


def _resolution(layers: int, rows: int, cols: int, cells: int) -> tuple[int, int]:
    """Return how many cells are drawn up and along one layer."""
    own = (rows - 1) * (cols - 1)
    factor = np.sqrt(cells * (1.0 + 0.5 * (layers - 1)) / layers / own)
    most = min(1.0, np.sqrt(MOST_CELLS / layers / own))
    down = round((rows - 1) * max(factor / NARROWING, most))
    along = round((cols - 1) * max(factor * NARROWING, most))
    return max(1, down), max(1, along)


def _places(cells: int, borders: tuple[float, ...]) -> Array:
    """Return where vertices lie, from 0 to 1: evenly between borders of the pattern, which are among them."""
    edges = (0.0, *borders, 1.0)
    parts = [np.linspace(a, b, max(1, round(cells * (b - a))), endpoint=False) for a, b in pairwise(edges)]
    return np.concatenate([*parts, [1.0]])


def _linear(count: int, places: Array) -> tuple[Array, Array]:
    """Return the matrices (places, count) of linear interpolation between equally spaced values, and of its slope: not used."""
    at = places * (count - 1.0)
    matrix = np.asarray(np.maximum(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0))
    return matrix, matrix


def _catmull_rom(count: int, places: Array) -> tuple[Array, Array]:
    """Return the matrices (places, count) of Catmull-Rom interpolation between equally spaced values, and of its slope."""
    at = places * (count - 1.0)
    left = np.clip(np.floor(at).astype(int), 0, count - 2)
    t = at - left
    weights = (-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, -(t**2) + t**3)
    slopes = (-1 + 4 * t - 3 * t**2, -10 * t + 9 * t**2, 1 + 8 * t - 9 * t**2, -2 * t + 3 * t**2)
    return _banded(count, left, weights), _banded(count, left, slopes)


def _banded(count: int, left: NDArray[np.intp], weights: tuple[Array, ...]) -> Array:
    """Return half of these weights of the values around each place as a matrix; beyond both ends values go on linearly."""
    padded = np.zeros((len(left), count + 2))
    for k, weight in enumerate(weights):
        padded[np.arange(len(left)), left + k] += 0.5 * weight
    matrix = padded[:, 1:-1].copy()
    matrix[:, 0] += 2.0 * padded[:, 0]
    matrix[:, 1] -= padded[:, 0]
    matrix[:, -1] += 2.0 * padded[:, -1]
    matrix[:, -2] -= padded[:, -1]
    return matrix


def _pattern(v: Array, u: Array, palette: Palette) -> Array:
    """Return the colours of the cells between vertices, shape (down, along, 3): quarters parted by a cross off the middle."""
    up, along = (0.5 * (places[1:] + places[:-1]) for places in (v, u))
    first, second, cross, heading = (np.array(color) for color in palette)
    quarter = (up[:, None] > 0.5) == (along < _MIDDLE)
    colors = np.where(quarter[..., None], first, second)
    on_cross = (np.abs(up - 0.5) < _HALF)[:, None] | (np.abs(along - _MIDDLE) < 2.0 / 3.0 * _HALF)
    colors = np.where(on_cross[..., None], cross, colors)
    return np.where((along < _HEADING)[None, :, None], heading, colors)


def _sampled(texture: Array, down: int, along: int) -> Array:
    """Return the cells' colours, shape (down, along, 3), from a texture whose first row is on top."""
    height, width, _ = texture.shape
    rows = ((np.arange(down)[::-1] + 0.5) / down * height).astype(int)
    cols = ((np.arange(along) + 0.5) / along * width).astype(int)
    return np.asarray(texture[rows[:, None], cols])
