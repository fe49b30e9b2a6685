"""Compiled looks at a batch of flags: what each control step asks of every flag, in one pass over its numbers.

Each flag is looked at by itself, in one order, so that its bits do not depend on how many there are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flag_env.physics.jit import cached, entry_point


def _settle(x: Any, v: Any, last_x: Any, last_v: Any, target: Any, room: float, fastest: float, diagonal: float,
            distance: Any, ended: Any) -> None:  # fmt: skip
    """Where positions x [m] or velocities v [m/s] (copies, 3 particles) leave their bounds or the finite numbers, set `ended`
    and bring back the last ones; then write the RMS distance of the particles to their targets, in flag diagonals.
    """
    particles = x.shape[1] / 3
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


def _observe(x: Any, v: Any, target: Any, nodes: Any, unit: float, actuators: Any, elapsed: Any, steps: int, limit: float,
             out: Any) -> None:  # fmt: skip
    """Nodes' positions, velocities, targets, differences in `unit`, actuators and time left of `steps`, clipped, into `out`."""
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
        out[copy, 4 * n + actuators.shape[1]] = max(1.0 - elapsed[copy] / steps, 0.0)


def _judge(distance: Any, tolerance: float, hold: int, elapsed: Any, held: Any, success: Any) -> None:
    """Count the step, and those in a row within tolerance; `hold` of them are a success."""
    for copy in range(distance.shape[0]):
        elapsed[copy] += 1
        held[copy] = held[copy] + 1 if distance[copy] < tolerance else 0
        success[copy] = held[copy] >= hold


def _admit(actions: Any) -> bool:
    """Clip flat actions to [-1, 1]; False, and nothing more, where one is not finite."""
    for i in range(actions.shape[0]):
        if (actions[i] - actions[i]) != 0.0:
            return False
        actions[i] = min(max(actions[i], -1.0), 1.0)
    return True


_ROWS, _FLAT = np.zeros((1, 3)), np.zeros(1)
_NUMBERS = np.zeros(1, np.int64)


@cache
def settle() -> Callable[..., None]:
    """`_settle`, compiled and kept on disk; all arrays float64 and contiguous, but for `ended`."""
    arguments = (*[_ROWS] * 5, 0.0, 0.0, 0.0, _FLAT, np.zeros(1, bool))
    return entry_point(cached(_settle, frozenset({Path(__file__)})), arguments)


@cache
def observe() -> Callable[..., None]:
    """`_observe`, compiled and kept on disk; arrays contiguous, `nodes` and `elapsed` int64, `out` float32, others float64."""
    arguments = (*[_ROWS] * 3, _NUMBERS, 0.0, _ROWS, _NUMBERS, 1, 0.0, np.zeros((1, 3), np.float32))
    return entry_point(cached(_observe, frozenset({Path(__file__)})), arguments)


@cache
def judge() -> Callable[..., None]:
    """`_judge`, compiled and kept on disk; all arrays contiguous, `distance` float64, `elapsed` and `held` int64."""
    arguments = (_FLAT, 0.0, 1, _NUMBERS, _NUMBERS, np.zeros(1, bool))
    return entry_point(cached(_judge, frozenset({Path(__file__)})), arguments)


@cache
def admit() -> Callable[[Any], bool]:
    """`_admit`, compiled and kept on disk, for contiguous float64."""
    return entry_point(cached(_admit, frozenset({Path(__file__)})), (_FLAT,))
