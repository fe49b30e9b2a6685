"""The flag and its mast as quads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.render.camera import Camera
from flag_env.render.shading import Quads, shade_cells
from flag_env.render.solids import balls, join, tube
from flag_env.render.style import Palette, Style
from flag_env.render.surface import cells_of, surface_for

__all__ = ["Body", "flag_body", "mast_axis", "mast_quads"]

Array = NDArray[np.float64]

_POLE: tuple[float, float, float] = (0.80, 0.78, 0.75)
_FINIAL: tuple[float, float, float] = (0.93, 0.74, 0.30)
_POLE_POINTS = 25
_LONGEST_POLE = 4.0  # times the diagonal of the box


class Body(NamedTuple):
    """A flag as it is drawn.

    Attributes
    ----------
        quads: its cells, in no order.
        outlines: polylines [pixel], each of shape (k, 3): x, y, and depth [m], that trace its edge; none of a torn flag.
        shade: points [m], shape (m, 3), that cast the shadow.
    """

    quads: Quads
    outlines: list[Array]
    shade: Array


def flag_body(camera: Camera, positions: Array, size: float, style: Style, intact: NDArray[np.bool_] | None = None) -> Body:
    """Return a lattice as it is drawn: cloth, or ropes if it is one row or one column wide.

    Args:
        camera: what it is seen by.
        positions: particle positions [m], shape (layers, rows, cols, 3).
        size: a length [m] that thick things are measured by.
        style: colours and pattern of the cloth; the first field also colours a rope.
        intact: which cells are cloth, shape (layers, rows - 1, cols - 1); None: all are.
    """
    if min(positions.shape[1:3]) < 2:
        return _rope(camera, positions.reshape(len(positions), -1, 3), size, style.palette)
    torn = intact is not None and not intact.all()
    surface = surface_for(*positions.shape[:3], style, torn)
    vertices = surface.vertices(positions)
    pixels, depth = camera.project(vertices)
    corners = cells_of(pixels)
    colors = shade_cells(surface.light(positions, vertices, camera.rotation[2]), corners, surface.albedo)
    middle = 0.25 * (depth[:, :-1, :-1] + depth[:, :-1, 1:] + depth[:, 1:, 1:] + depth[:, 1:, :-1])
    quads = Quads(corners, colors, middle.reshape(-1))
    if intact is not None and torn:
        cloth = surface.cells(intact)
        drawn = cloth.ravel()
        return Body(Quads(corners[drawn], colors[drawn], quads.depth[drawn]), [], vertices[:, 1:, 1:][cloth])
    outline = np.concatenate([pixels[0].reshape(-1, 2), depth[0].reshape(-1, 1)], axis=1)[surface.outline]
    return Body(quads, [outline], vertices.reshape(-1, 3))


def mast_axis(mast: Array, bounds: Array) -> Array:
    """Return both ends of the pole [m], shape (2, 3).

    Args:
        mast: lowest and highest point of the hoist [m], shape (2, 3); the pole goes on down to the ground.
        bounds: lowest and highest corner of the view box [m], shape (2, 3); its floor is the ground.
    """
    foot, top = mast
    length = float(np.linalg.norm(top - foot))
    axis = (top - foot) / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    drop = max(float(foot[2] - bounds[0, 2]), 0.0)
    down = drop / axis[2] if axis[2] > 1e-3 else 0.0
    longest = _LONGEST_POLE * float(np.linalg.norm(bounds[1] - bounds[0]))
    size = max(length, 0.25 * drop)
    return np.stack([foot - min(down, longest) * axis, top + 0.05 * size * axis])


def mast_quads(camera: Camera, ends: Array, size: float) -> Quads:
    """Return the pole between `ends` [m], shape (2, 3), and a ball on top, sized by `size` [m]."""
    share = np.linspace(0.0, 1.0, _POLE_POINTS)
    line = ends[0] + share[:, None] * (ends[1] - ends[0])
    radius = 0.013 * size * (1.0 - 0.25 * share)
    finial = balls(camera, ends[1:], np.array([0.026 * size]), _FINIAL, 2, 10)
    return join([tube(camera, line, radius, _POLE, 2), finial])


def _rope(camera: Camera, strands: Array, size: float, palette: Palette) -> Body:
    """Return strands [m], shape (layers, n, 3), as tubes with a bead on each particle."""
    radius = 0.012 * size
    parts = [balls(camera, strands.reshape(-1, 3), np.full(strands[..., 0].size, radius), palette.second, 2, 8)]
    outlines = []
    for strand in strands if strands.shape[1] > 1 else []:
        parts.append(tube(camera, strand, np.full(len(strand), 0.45 * radius), palette.first, 2))
        pixels, depth = camera.project(strand)
        outlines.append(np.concatenate([pixels, depth[:, None]], axis=1))
    return Body(join(parts), outlines, strands.reshape(-1, 3))
