"""Rigid motion of the pinned particles."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.physics.compiling import cached, entry_point


def rotation(tilt: NDArray[np.float64], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices R = Ry(tilt_y) Rx(tilt_x) Rz(yaw), shape (n, 3, 3), for tilt (n, 2) and yaw (n,) [rad]."""
    (sx, sy), sz = np.sin(tilt).T, np.sin(yaw)
    (cx, cy), cz = np.cos(tilt).T, np.cos(yaw)
    rows = (
        (cy * cz + sy * sx * sz, -cy * sz + sy * sx * cz, sy * cx),
        (cx * sz, cx * cz, -sx),
        (-sy * cz + cy * sx * sz, sy * sz + cy * sx * cz, cy * cx),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def mast_points(
    rest: NDArray[np.float64], position: NDArray[np.float64], tilt: NDArray[np.float64], yaw: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Points fixed to n masts [m], shape (n, points, 3), for `rest` (points, 3) and poses (n, 3), (n, 2), (n,)."""
    return np.asarray(np.einsum("nij,pj->npi", rotation(tilt, yaw), rest) + position[:, None])


def mast_poses(
    copies: int, position: ArrayLike, tilt: ArrayLike, yaw: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Poses of each copy's mast, (copies, 3), (copies, 2), (copies,), from those of each or of all; ValueError unless finite."""
    position = np.broadcast_to(_validate.array("position", position, (3,), (copies, 3)), (copies, 3))
    tilt = np.broadcast_to(_validate.array("tilt", tilt, (2,), (copies, 2)), (copies, 2))
    yaw = np.broadcast_to(_validate.array("yaw", yaw, (), (copies,)), (copies,))
    return position, tilt, yaw


def _pull(x: Any, v: Any, pinned: Any, mast_targets: Any, seconds: float) -> bool:
    """Velocities v (copies, coordinates, particles) that bring the pinned particles to the mast's points in `seconds`.

    True if any of them is not zero.
    """
    number = x.dtype.type
    moving = False
    for copy in range(x.shape[0]):
        for d in range(x.shape[1]):
            for k in range(pinned.shape[0]):
                v[copy, d, pinned[k]] = (number(mast_targets[copy, d, k]) - x[copy, d, pinned[k]]) / number(seconds)
                moving |= v[copy, d, pinned[k]] != 0
    return moving


@cache
def pull(dtype: np.dtype[Any]) -> Callable[..., bool]:
    """`_pull`, compiled for x and v of this type and kept on disk; contiguous arrays, `pinned` int64, `mast` float64."""
    rows = np.zeros((1, 1, 1), dtype)
    return entry_point(cached(_pull), (rows, rows, np.zeros(1, np.int64), np.zeros((1, 1, 1)), 0.0))
