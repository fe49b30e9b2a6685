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
    """Sky and ground of some rows of the picture, RGB, shape (rows, width, 3)."""
    x, y = np.meshgrid(np.arange(width) + 0.5, height - rows - 0.5)
    rays = np.stack([(x - camera.centre[0]) / camera.focal, (y - camera.centre[1]) / camera.focal, np.ones_like(x)], -1)
    rays = rays @ camera.rotation
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    rise = np.clip(rays[..., 2:] / 0.30, 0.0, 1.0)
    sky = _HORIZON + (_ZENITH - _HORIZON) * rise**0.8
    down = np.minimum(rays[..., 2], -1e-4)
    distance = (bounds[0, 2] - camera.eye[2]) / down
    hit = camera.eye[:2] + distance[..., None] * rays[..., :2]
    # A pixel's footprint on the ground smooths the lines; where it outgrows the grid, they fade out.
    footprint = (distance / camera.focal / np.sqrt(-down))[..., None]
    off = np.abs(hit / _GRID - np.round(hit / _GRID)) * _GRID
    line = np.clip((0.5 * _LINE_WIDTH + 0.5 * footprint - off) / footprint, 0.0, 1.0)
    line *= np.clip(1.5 - 6.0 * footprint / _GRID, 0.0, 1.0)
    line = line.max(axis=-1, keepdims=True)
    ground = _GROUND + (_LINE - _GROUND) * line
    reach = float(np.linalg.norm(bounds.mean(axis=0) - camera.eye))
    haze = 1.0 - np.exp(-(np.maximum(distance[..., None] / reach - 0.75, 0.0) ** 2) / _HAZE)
    ground += (_HORIZON - ground) * haze
    color = np.where(rays[..., 2:] < -1e-4, ground, sky)
    middle = np.hypot((x / width - 0.5), (y / height - 0.5))[..., None]
    color *= 1.0 - 0.16 * np.clip(middle - 0.25, 0.0, 1.0)
    return np.asarray(np.round(255.0 * np.clip(color, 0.0, 1.0)), dtype=np.uint8)


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
