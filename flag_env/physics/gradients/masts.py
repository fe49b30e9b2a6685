"""Poses of the mast as a rollout takes them, and derivatives with respect to them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.runtime import mast_points

_SMALL = 1e-30
"""Imaginary part of a pose: the points are analytic in it, and an imaginary part loses no digits."""


def points_of(rest: NDArray[np.float64], poses: NDArray[Any]) -> NDArray[Any]:
    """Points of masts [m], (n, points, 3), at poses (n, 5 or 6): x, y, z [m], tilt about x, about y, yaw [rad]."""
    yaw = poses[:, 5] if poses.shape[1] > 5 else np.zeros(len(poses))
    return mast_points(rest, poses[:, :3], poses[:, 3:5], yaw)


def poses_back(rest: NDArray[np.float64], poses: NDArray[np.float64], dpoints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives with respect to the poses, from those with respect to the points."""
    result = np.empty_like(poses)
    result[:, :3] = dpoints.sum(axis=1)
    for column in range(3, poses.shape[1]):
        moved = poses.astype(np.complex128)
        moved[:, column] += _SMALL * 1j
        result[:, column] = (points_of(rest, moved).imag / _SMALL * dpoints).sum(axis=(1, 2))
    return result
