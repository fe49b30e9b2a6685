"""Round bodies as shaded quads: tubes, balls and cones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flag_env.render.camera import Camera
from flag_env.render.shading import Quads, flat, lambert

__all__ = ["arrow", "balls", "join", "tube"]

Array = NDArray[np.float64]
Color = tuple[float, float, float]

_SIDES = 16  # of an arrow
_ANGLE = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
_CIRCLE: Array = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=-1)
_SPOKES: Array = 0.5 * (_CIRCLE[:-1] + _CIRCLE[1:])


def join(parts: list[Quads]) -> Quads:
    """Return the quads of all parts, farthest first (painter's order)."""
    corners = np.concatenate([part.corners for part in parts])
    colors = np.concatenate([part.colors for part in parts])
    depth = np.concatenate([part.depth for part in parts])
    order = np.argsort(-depth, kind="stable")
    return Quads(corners[order], colors[order], depth[order])


def tube(camera: Camera, line: Array, radius: Array, color: Color, strips: int = 3) -> Quads:
    """Return the visible half of a tube.

    Args:
        camera: what it is seen by.
        line: points on the axis [m], shape (n, 3), n >= 2.
        radius: radius at each point [m], shape (n,).
        color: colour of the surface, RGB from 0 to 1.
        strips: strips across the visible half.
    """
    away = camera.eye - line
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    tangent = np.empty_like(line)
    tangent[1:-1] = line[2:] - line[:-2]
    tangent[0], tangent[-1] = line[1] - line[0], line[-1] - line[-2]
    side = _unit(_cross(tangent, away), camera.rotation[0])
    across = np.linspace(-1.0, 1.0, strips + 1)
    rim = line[:, None] + (radius[:, None] * across)[..., None] * side[:, None]
    pixels, depth = camera.project(rim)
    corners = np.stack([pixels[:-1, :-1], pixels[:-1, 1:], pixels[1:, 1:], pixels[1:, :-1]], axis=2)
    turned = 0.75 * across  # not all the way round: rims as dark as they are would part a thin tube in two
    normals = turned[:, None] * side[:, None] + np.sqrt(1.0 - turned**2)[:, None] * away[:, None]
    shades = np.minimum(lambert(normals) * np.array(color), 1.0)
    colors = np.stack([shades[:-1, :-1], shades[:-1, 1:], shades[1:, 1:], shades[1:, :-1]], axis=2)
    # Nearer than the surface, or cells of the cloth pinned to the axis would show through between segments.
    near = 0.25 * (depth[:-1, :-1] + depth[:-1, 1:] + depth[1:, 1:] + depth[1:, :-1]) - 2.0 * radius[:-1, None]
    return Quads(corners.reshape(-1, 4, 2), colors.reshape(-1, 4, 3), near.reshape(-1))


def balls(camera: Camera, centres: Array, radius: Array, color: Color, rings: int = 3, sides: int = 12) -> Quads:
    """Return the visible halves of balls at `centres` [m], shape (n, 3), of `radius` [m], shape (n,)."""
    pixels, depth = camera.project(centres)
    size = radius * camera.scale(depth)
    edge = np.sin(np.linspace(0.0, 0.5 * np.pi, rings + 1))
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    disc = edge[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    patch = np.stack([disc[:-1, :-1], disc[:-1, 1:], disc[1:, 1:], disc[1:, :-1]], axis=2).reshape(-1, 4, 2)
    middle = patch.mean(axis=1)
    toward = np.sqrt(np.maximum(1.0 - (middle**2).sum(axis=1), 0.0))
    normals = np.concatenate([middle, -toward[:, None]], axis=1) @ camera.rotation
    shades = np.minimum(lambert(normals) * np.array(color), 1.0)
    corners = pixels[:, None, None] + size[:, None, None, None] * patch
    colors = np.broadcast_to(shades, (len(centres), *shades.shape))
    near = np.repeat(depth - radius, len(patch))
    return Quads(corners.reshape(-1, 4, 2), flat(colors.reshape(-1, 3)), near)


def arrow(along: Array, rotation: Array, origin: Array, scale: float, radius: float, color: Color) -> Quads:
    """Return an arrow in parallel projection, in painter's order.

    Args:
        along: the arrow as a vector from its tail at `origin`, in lengths of `scale`, shape (3,).
        rotation: rows are the view's right, up and forward, shape (3, 3).
        origin: where the tail is seen [pixel], shape (2,).
        scale: pixels that a length of one covers across the line of sight.
        radius: radius of the shaft, in lengths of `scale`.
        color: colour of the surface, RGB from 0 to 1.
    """
    length = float(np.linalg.norm(along))
    if length < 1e-6:
        view = Camera(rotation, -1e3 * rotation[2], 1e3 * scale, origin)
        return balls(view, np.zeros((1, 3)), np.array([1.6 * radius]), color)
    axis = along / length
    frame, flat_axis = _across(axis), rotation[:2] @ axis
    # Four loops of points: the shaft's ends, the head's rim and its tip.
    neck = max(length - 6.0 * radius, 0.0)
    far = scale * np.array([0.0, neck, neck, length])
    wide = scale * radius * np.array([1.0, 1.0, 2.6, 0.0])
    loops = origin + far[:, None, None] * flat_axis + wide[:, None, None] * (_CIRCLE @ (frame @ rotation[:2].T))
    # Three rings of quads between them: shaft, mantle and cap of the head.
    low, high = loops[[0, 2, 1]], loops[[1, 3, 2]]
    corners = np.empty((3, _SIDES, 4, 2))
    corners[:, :, 0], corners[:, :, 1] = low[:, :-1], low[:, 1:]
    corners[:, :, 2], corners[:, :, 3] = high[:, 1:], high[:, :-1]
    normals = np.empty((3, _SIDES, 3))
    normals[0] = _SPOKES @ frame
    normals[1] = 0.92 * normals[0] + 0.4 * axis
    normals[2] = -axis
    shades = np.minimum(lambert(normals) * np.array(color), 1.0)
    away = float(axis @ rotation[2]) > 0.0
    order = [1, 2, 0] if away else [2, 0, 1]  # the nearer part last
    seen = (normals @ rotation[2] < 0.0)[order]
    return Quads(corners[order][seen], flat(shades[order][seen]), np.zeros(int(seen.sum())))


def _across(axis: Array) -> Array:
    """Return two unit vectors, shape (2, 3), that make a right-handed frame with the unit vector `axis`."""
    x, y, z = axis.tolist()
    if abs(z) < 0.9:
        size = float(np.hypot(x, y))
        a, b, c = y / size, -x / size, 0.0
    else:
        size = float(np.hypot(y, z))
        a, b, c = 0.0, z / size, -y / size
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of two arrays of shape (n, 3); np.cross is slow on short ones."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def _unit(vectors: Array, otherwise: Array) -> Array:
    """Return `vectors`, shape (n, 3), scaled to length one; `otherwise`, shape (3,), where they vanish."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), otherwise)
