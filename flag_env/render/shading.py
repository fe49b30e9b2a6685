"""Light on faces and round bodies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["SUN", "Quads", "cloth_light", "flat", "lambert", "shade_cells"]

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
        colors: of the corners, between which they blend, RGB from 0 to 1, shape (n, 4, 3).
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


def cloth_light(along: Array, up: Array, forward: Array) -> Array:
    """Return the light on both faces of a cloth, shape (..., 2, 4): light that falls on it, RGB, and its sheen.

    The first face is the one that `along` x `up` stands on.

    Args:
        along: tangents along the cloth, component first, shape (3, ...), of any length.
        up: tangents up the cloth, likewise.
        forward: unit vector from the eye into the picture, shape (3,).
    """
    normal = np.stack([along[k - 2] * up[k - 1] - along[k - 1] * up[k - 2] for k in range(3)])
    normal /= np.sqrt((normal * normal).sum(axis=0)) + 1e-30
    half = (SUN - forward) / np.linalg.norm(SUN - forward)
    facing, shine = (np.tensordot(direction, normal, 1) for direction in (SUN, half))
    result = np.empty((*facing.shape, 2, 4))
    for face, sign in enumerate((1.0, -1.0)):
        sun, through = np.maximum(sign * facing, 0.0)[..., None], np.maximum(-sign * facing, 0.0)[..., None]
        sky = (0.72 + sign * 0.28 * normal[2])[..., None]
        result[..., face, :3] = sky * _SKY + sun * _SUNLIGHT + through * _THROUGH
        sheen = np.maximum(sign * shine, 0.0)
        for _ in range(4):  # to the power 16
            sheen = sheen * sheen
        result[..., face, 3] = _SHEEN * sheen
    return result


def shade_cells(light: Array, pixels: Array, albedo: Array) -> Array:
    """Return the colours at the corners of cloth cells, shape (n, 4, 3), each of the face that is seen.

    Args:
        light: on both faces at the corners, shape (n, 4, 2, 4).
        pixels: projected corners [pixel], shape (n, 4, 2), anticlockwise seen from the front.
        albedo: colours of the front and back faces, shape (2, n, 3).
    """
    flat_a, flat_b = pixels[:, 2] - pixels[:, 0], pixels[:, 3] - pixels[:, 1]
    front = (flat_a[:, 0] * flat_b[:, 1] > flat_a[:, 1] * flat_b[:, 0])[:, None]
    seen = np.where(front[..., None], light[:, :, 0], light[:, :, 1])
    colors = np.where(front, albedo[0], albedo[1])[:, None] * seen[..., :3] + seen[..., 3:]
    return np.asarray(np.minimum(colors, 1.0))


def flat(colors: Array) -> Array:
    """Return one colour a quad, shape (n, 3), as those of its corners, shape (n, 4, 3)."""
    return np.repeat(colors[:, None], 4, axis=1)
