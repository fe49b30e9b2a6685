"""What does not move: sky and ground; and what falls on it: the shadow."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.render.camera import Camera
from flag_env.render.layer import Layer

__all__ = ["Shadow", "backdrop"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_ZENITH = np.array([0.560, 0.715, 0.870])
_HORIZON = np.array([0.930, 0.945, 0.945])
_GROUND = np.array([0.835, 0.820, 0.780])
_LINE = np.array([0.720, 0.710, 0.680])
_LINE_WIDTH = 0.012  # m
_HAZE = 1.6  # the ground fades into the horizon over this many distances of the box
_GRID = 0.5  # m between the lines on the ground

_BAND = 2**18  # pixels of the backdrop that are painted at once

_SHRINK = 6  # the shadow's blur hides a lower resolution, which touches 36 times fewer pixels
_BLUR = 1.3  # pixels of the small picture
_REACH = 4  # pixels of the small picture that the blur spreads over
_DARKNESS = np.array([0, 45, 70, 82, 88], dtype=np.uint8)  # opacity by how many points fall on a pixel
# Steeper than the light on the cloth, so that the shadow stays beneath the flag and tells where it is.
_SLANT = np.array([0.22, 0.18])


def backdrop(camera: Camera, bounds: Array, width: int, height: int) -> Pixels:
    """Return sky and gridded ground, RGBA, shape (height, width, 4).

    Args:
        camera: what they are seen by.
        bounds: lowest and highest corner of the view box [m], shape (2, 3); its floor is the ground.
        width: width of the picture [pixel].
        height: height of the picture [pixel].
    """
    rgba = np.full((height, width, 4), 255, dtype=np.uint8)
    band = max(1, _BAND // width)
    for top in range(0, height, band):  # whole pictures of numbers would take gigabytes
        rows = np.arange(top, min(top + band, height))
        rgba[top : top + len(rows), :, :3] = _band(camera, bounds, rows, width, height)
    return rgba


def _band(camera: Camera, bounds: Array, rows: NDArray[Any], width: int, height: int) -> Pixels:
    """Sky and ground of some rows of the picture, RGB, shape (rows, width, 3), in single precision."""
    single = np.float32
    x = (np.arange(width, dtype=single) + single(0.5))[None, :]
    y = (height - rows - 0.5).astype(single)[:, None]
    right, up, forward = camera.rotation.astype(single)
    across, upward = (x - single(camera.centre[0])) / single(camera.focal), (y - single(camera.centre[1])) / single(camera.focal)
    length = np.sqrt(1 + across**2 + upward**2)
    ray_x, ray_y, ray_z = ((across * right[k] + upward * up[k] + forward[k]) / length for k in range(3))
    rise = np.clip(ray_z / single(0.30), 0, 1) ** single(0.8)
    down = np.minimum(ray_z, single(-1e-4))
    distance = single(bounds[0, 2] - camera.eye[2]) / down
    # A pixel's footprint on the ground smooths the lines; where it outgrows the grid, they fade out.
    footprint = distance / single(camera.focal) / np.sqrt(-down)
    line = np.zeros_like(distance)
    for eye, ray in zip(camera.eye[:2].astype(single), (ray_x, ray_y), strict=True):
        place = (eye + distance * ray) / single(_GRID)
        off = np.abs(place - np.rint(place)) * single(_GRID)
        np.maximum(line, (single(0.5 * _LINE_WIDTH) + single(0.5) * footprint - off) / footprint, out=line)
    line = np.minimum(line, 1) * np.clip(single(1.5) - single(6.0 / _GRID) * footprint, 0, 1)
    reach = float(np.linalg.norm(bounds.mean(axis=0) - camera.eye))
    haze = 1 - np.exp(np.maximum(distance / single(reach) - single(0.75), 0) ** 2 / single(-_HAZE))
    ground = ray_z < -1e-4
    middle = np.hypot(x / single(width) - single(0.5), y / single(height) - single(0.5))
    edge = single(255) - single(255 * 0.16) * np.clip(middle - single(0.25), 0, 1)
    band = np.empty((len(rows), width, 3), np.uint8)
    for channel in range(3):
        horizon, zenith, plain, ruled = (single(color[channel]) for color in (_HORIZON, _ZENITH, _GROUND, _LINE))
        floor = plain + (ruled - plain) * line
        floor += (horizon - floor) * haze
        band[..., channel] = np.rint(np.where(ground, floor, horizon + (zenith - horizon) * rise) * edge)
    return band


class Shadow:
    """A soft shadow: points are counted in a small picture, which is blurred, enlarged and blended."""

    def __init__(self, width: int, height: int) -> None:
        """Prepare for pictures of `width` x `height` pixels."""
        self._wide, self._high = -(-width // _SHRINK), -(-height // _SHRINK)

    def draw(self, layer: Layer, camera: Camera, ground: float, points: Array) -> None:
        """Darken `layer` where points keep the light off the ground.

        Args:
            layer: what is drawn into.
            camera: what the ground is seen by.
            ground: height of the ground [m].
            points: points of what stands in the light [m], shape (n, 3), a few per small pixel.
        """
        from PIL import Image, ImageFilter

        lift = np.maximum(points[:, 2:] - ground, 0.0)
        flat = np.empty_like(points)
        flat[:, :2] = points[:, :2] + lift * _SLANT
        flat[:, 2] = ground
        spots = (camera.project(flat)[0] / _SHRINK).astype(np.int64)
        inside = (spots >= 0).all(axis=1) & (spots[:, 0] < self._wide) & (spots[:, 1] < self._high)
        x, y = spots[inside].T
        if x.size == 0:
            return
        left, right = max(int(x.min()) - _REACH, 0), min(int(x.max()) + _REACH + 1, self._wide)
        bottom, top = max(int(y.min()) - _REACH, 0), min(int(y.max()) + _REACH + 1, self._high)
        rows, cols = top - bottom, right - left
        count = np.bincount((top - 1 - y) * cols + x - left, minlength=rows * cols)
        mask = Image.fromarray(_DARKNESS[np.minimum(count, len(_DARKNESS) - 1)].reshape(rows, cols))
        size = (_SHRINK * cols, _SHRINK * rows)
        mask = mask.filter(ImageFilter.GaussianBlur(_BLUR)).resize(size, Image.Resampling.BILINEAR)
        rgba = np.zeros((size[1], size[0], 4), dtype=np.uint8)
        rgba[..., 2] = 30
        rgba[..., 3] = np.asarray(mask)
        layer.image(_SHRINK * left, _SHRINK * bottom, rgba)
