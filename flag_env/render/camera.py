"""The perspective camera that frames a fixed box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Camera", "view"]

Array = NDArray[np.float64]

STANDOFF = 1.9  # distance of the eye from the centre of the box, in box diagonals
ROUNDING = 0.80  # the box's corners are drawn in to this share, since flags swing round and seldom visit them
MARGIN = 0.03  # fraction of the picture left free on each side
NEAR = 0.05  # nearest depth that is projected, as a fraction of the standoff
FAR_PIXELS = 2e4  # projections are clipped to this, which Agg's 24.8 fixed point holds with room


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera: screen = centre + focal * (right, up) / depth.

    Attributes
    ----------
        rotation: rows are the unit vectors right, up and forward, shape (3, 3).
        eye: position of the pinhole [m], shape (3,).
        focal: focal length [pixel].
        centre: pixel on which the forward axis falls, shape (2,); x to the right, y up from the lower left.
        near: depth [m] at which nearer points are projected, so that nothing is divided by zero.
    """

    rotation: Array
    eye: Array
    focal: float
    centre: Array
    near: float = 1e-6

    @classmethod
    def framing(cls, bounds: Array, width: int, height: int, azimuth: float = -62.0, elevation: float = 15.0) -> Camera:
        """Return the camera that shows the box, its corners rounded off, as large as the picture allows.

        Args:
            bounds: lowest and highest corner of the box [m], shape (2, 3).
            width: width of the picture [pixel].
            height: height of the picture [pixel].
            azimuth: where the eye stands, degrees about z; 0 looks along -x, -90 along +y.
            elevation: of the eye above the horizon, degrees.
        """
        rotation = view(azimuth, elevation)
        toward = -rotation[2]
        centre, half = bounds.mean(axis=0), 0.5 * (bounds[1] - bounds[0])
        standoff = STANDOFF * 2.0 * float(np.linalg.norm(half))
        eye = centre + standoff * toward
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(8, 3)
        rounded = centre + half * np.concatenate([ROUNDING * signs, np.eye(3), -np.eye(3)])
        # With the eye fixed, focal length and principal point only scale and shift the picture:
        # the best fit is closed form.
        flat, _ = cls(rotation, eye, 1.0, np.zeros(2)).project(rounded)
        low, high = flat.min(axis=0), flat.max(axis=0)
        size = np.array([width, height], dtype=np.float64)
        focal = float(np.min((1.0 - 2.0 * MARGIN) * size / (high - low)))
        return cls(rotation, eye, focal, 0.5 * size - 0.5 * focal * (low + high), NEAR * standoff)

    def project(self, points: Array) -> tuple[Array, Array]:
        """Project points.

        Args:
            points: positions [m], shape (..., 3).

        Returns
        -------
            Pixels, shape (..., 2), and depths along the forward axis [m], shape (...).
        """
        view = (points - self.eye) @ self.rotation.T
        depth = np.maximum(view[..., 2], self.near)
        pixels = view[..., :2] * (self.focal / depth)[..., None] + self.centre
        return np.clip(pixels, -FAR_PIXELS, FAR_PIXELS, out=pixels), depth

    def scale(self, depth: Array) -> Array:
        """Return how many pixels a metre across the line of sight covers at `depth` [m], any shape."""
        return self.focal / depth


def view(azimuth: float, elevation: float) -> Array:
    """Return the unit vectors right, up and forward, shape (3, 3), of an eye at these angles in degrees."""
    turn, rise = np.radians([azimuth, elevation])
    toward = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    right = np.cross(-toward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), -toward])
