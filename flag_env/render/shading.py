"""Light on faces and round bodies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["SUN", "Quads", "lambert", "shade_cells"]

Array = NDArray[np.float64]

# Towards the light: from the front, high, and from the mast's side, so that folds, whose normals turn towards
# +-x, alternate between light and shade.
SUN: Array = np.array([-0.55, -0.64, 0.54]) / np.linalg.norm([-0.55, -0.64, 0.54])

_SKY = np.array([0.71, 0.72, 0.755])
_SUNLIGHT = np.array([0.56, 0.535, 0.48])
_THROUGH = np.array([0.10, 0.075, 0.045])  # light that shines through the cloth from behind
_SHEEN = 0.13


class Quads(NamedTuple):
    """Opaque quads ready to be drawn.

    Attributes
    ----------
        corners: vertices [pixel], shape (n, 4, 2).
        colors: RGB from 0 to 1, shape (n, 3).
        depth: depth of the middle along the line of sight [m], shape (n,); larger is farther.
    """

    corners: Array
    colors: Array
    depth: Array


def lambert(normals: Array) -> Array:
    """Return the light, RGB, that falls on opaque faces with unit `normals`; both of shape (..., 3)."""
    sky = 0.72 + 0.28 * normals[..., 2:]
    sun = np.maximum(normals @ SUN, 0.0)[..., None]
    return np.asarray(sky * _SKY + sun * _SUNLIGHT)


def shade_cells(vertices: Array, pixels: Array, albedo: Array, forward: Array) -> Array:
    """Return the colours, shape (n, 3), of cloth cells lit on both sides.

    Args:
        vertices: grid of vertices [m], shape (layers, up, along, 3).
        pixels: projected corners of its cells [pixel], shape (n, 4, 2), anticlockwise seen from the front.
        albedo: colours of the front and back faces, shape (2, n, 3).
        forward: unit vector from the eye into the picture, shape (3,).
    """
    a = (vertices[:, 1:, 1:] - vertices[:, :-1, :-1]).reshape(-1, 3)
    b = (vertices[:, 1:, :-1] - vertices[:, :-1, 1:]).reshape(-1, 3)
    normal = np.empty_like(a)
    normal[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    normal[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    normal[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    flat_a, flat_b = pixels[:, 2] - pixels[:, 0], pixels[:, 3] - pixels[:, 1]
    front = flat_a[:, 0] * flat_b[:, 1] > flat_a[:, 1] * flat_b[:, 0]
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal)) + 1e-30
    normal *= (np.where(front, 1.0, -1.0) / length)[:, None]  # now towards the eye
    facing = normal @ SUN
    half = SUN - forward
    sheen = np.maximum(normal @ (half / np.linalg.norm(half)), 0.0)
    for _ in range(4):  # to the power 16
        sheen *= sheen
    light = lambert(normal)
    light += np.maximum(-facing, 0.0)[:, None] * _THROUGH
    colors = np.where(front[:, None], albedo[0], albedo[1]) * light
    colors += (_SHEEN * sheen)[:, None]
    return np.asarray(np.minimum(colors, 1.0))
