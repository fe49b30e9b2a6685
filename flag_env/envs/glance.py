"""Compiled looks at a batch of flags: what each control step asks of every flag, in one pass over its numbers.

Each flag is looked at by itself, in one order, so that its bits do not depend on how many there are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from flag_env.physics.jit import cached


def _settle(x: Any, v: Any, last_x: Any, last_v: Any, target: Any, room: Any, fastest: Any, particles: Any, diagonal: Any,
            distance: Any, ended: Any) -> None:  # fmt: skip
    """Where positions x [m] or velocities v [m/s] (copies, numbers) leave their bounds or the finite numbers, set `ended` and
    bring back the last ones; then write the RMS distance of the particles to their targets, in flag diagonals.
    """
    for copy in range(x.shape[0]):
        lost = False
        for i in range(x.shape[1]):
            if not (abs(x[copy, i]) <= room and abs(v[copy, i]) <= fastest):
                lost = True
                break
        ended[copy] = lost
        if lost:
            for i in range(x.shape[1]):
                x[copy, i] = last_x[copy, i]
                v[copy, i] = last_v[copy, i]
        square = 0.0
        for i in range(x.shape[1]):
            difference = x[copy, i] - target[copy, i]
            square += difference * difference
        distance[copy] = (square / particles) ** 0.5 / diagonal


def _observe(x: Any, v: Any, target: Any, nodes: Any, unit: Any, actuators: Any, left: Any, limit: Any, out: Any) -> None:
    """Nodes' positions, velocities, targets, differences in `unit`, actuators and time left, clipped, into `out`."""
    n = 3 * nodes.shape[0]
    for copy in range(x.shape[0]):
        for j in range(nodes.shape[0]):
            for d in range(3):
                i, k = 3 * nodes[j] + d, 3 * j + d
                out[copy, k] = min(max(x[copy, i], -limit), limit)
                out[copy, n + k] = min(max(v[copy, i], -limit), limit)
                out[copy, 2 * n + k] = min(max(target[copy, i], -limit), limit)
                out[copy, 3 * n + k] = min(max((target[copy, i] - x[copy, i]) / unit, -limit), limit)
        for k in range(actuators.shape[1]):
            out[copy, 4 * n + k] = min(max(actuators[copy, k], -limit), limit)
        out[copy, 4 * n + actuators.shape[1]] = left[copy]


@cache
def settle() -> Callable[..., None]:
    """`_settle`, compiled and kept on disk."""
    return cached(_settle, frozenset({Path(__file__)}))


@cache
def observe() -> Callable[..., None]:
    """`_observe`, compiled and kept on disk."""
    return cached(_observe, frozenset({Path(__file__)}))
