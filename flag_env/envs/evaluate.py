"""Compiled looks at a batch of flags: what each control step asks of every flag, in one pass over its numbers.

Each flag is looked at by itself, in one order, so that its bits do not depend on how many there are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flag_env.physics.compiling import cached, entry_point


def _evaluate_step(x: Any, v: Any, last_x: Any, last_v: Any, target: Any, ahead: Any, nodes: Any, actuators: Any,
          mast_target: Any, mast_first: int, largest_coordinate: float, largest_speed: float, diagonal: float, unit: float,
          ahead_unit: float, tolerance: float, hold: int, earliest: int, steps: int, bound: float, starts: Any, elapsed: Any,
          held: Any, before: Any, distance: Any, success: Any, diverged: Any, out: Any, stepped: bool, first: int,
          last: int) -> None:  # fmt: skip
    """Look at the flags `first <= copy < last` after a step; see `FlagBatch` for what the arrays hold.

    Where positions x [m] or velocities v [m/s] (copies, 3 particles) leave their bounds or the finite numbers, bring back the
    last ones; those flags are `diverged`. Write the RMS distance of the particles to their targets, in flag diagonals. Count the
    step, and those in a row within tolerance; `hold` of them are a success, from the step `earliest` on. Write the parts of
    `ObservationLayout` into `out`, each from its entry in `starts` on, clipped; one that starts at -1 is left out. `ahead`
    (copies, looks, 3 nodes) holds later targets [m], `mast_target` (copies, n) what the actuators from `mast_first` on are to
    be. Without `stepped`, only distances and `out`.
    """
    particles = x.shape[1] / 3
    for copy in range(first, last):
        bad, square = 0, 0.0
        for i in range(x.shape[1]):
            bad += not (abs(x[copy, i]) <= largest_coordinate)  # true of NaN too
            bad += not (abs(v[copy, i]) <= largest_speed)
            difference = x[copy, i] - target[copy, i]
            square += difference * difference
        if stepped:
            diverged[copy] = bad > 0
            if bad > 0:
                square = 0.0
                for i in range(x.shape[1]):
                    x[copy, i] = last_x[copy, i]
                    v[copy, i] = last_v[copy, i]
                    difference = x[copy, i] - target[copy, i]
                    square += difference * difference
        if stepped:
            before[copy] = distance[copy]
        distance[copy] = (square / particles) ** 0.5 / diagonal
        if stepped:
            elapsed[copy] += 1
            held[copy] = held[copy] + 1 if distance[copy] < tolerance else 0
            success[copy] = held[copy] >= hold and elapsed[copy] >= earliest
        for j in range(nodes.shape[0]):
            for d in range(3):
                i, k = 3 * nodes[j] + d, 3 * j + d
                out[copy, starts[0] + k] = min(max(x[copy, i], -bound), bound)
                if starts[1] >= 0:
                    out[copy, starts[1] + k] = min(max(v[copy, i], -bound), bound)
                if starts[2] >= 0:
                    out[copy, starts[2] + k] = min(max(target[copy, i], -bound), bound)
                if starts[3] >= 0:
                    out[copy, starts[3] + k] = min(max((target[copy, i] - x[copy, i]) / unit, -bound), bound)
                if starts[4] >= 0:
                    for look in range(ahead.shape[1]):
                        away = (ahead[copy, look, k] - x[copy, i]) / ahead_unit
                        out[copy, starts[4] + look * ahead.shape[2] + k] = min(max(away, -bound), bound)
        for k in range(actuators.shape[1]):
            out[copy, starts[5] + k] = min(max(actuators[copy, k], -bound), bound)
        if starts[6] >= 0:
            for k in range(mast_target.shape[1]):
                error = mast_target[copy, k] - actuators[copy, mast_first + k]
                out[copy, starts[6] + k] = min(max(mast_target[copy, k], -bound), bound)
                out[copy, starts[7] + k] = min(max(error, -bound), bound)
        out[copy, starts[8]] = max(1.0 - elapsed[copy] / steps, 0.0)


_ROWS, _FLAT = np.zeros((1, 3)), np.zeros(1)
_NUMBERS = np.zeros(1, np.int64)


@cache
def evaluate_step() -> Callable[..., None]:
    """`_evaluate_step`, compiled and kept on disk.

    All arrays are contiguous: positions, velocities, targets, actuators and distances in float64, numbers of nodes, of steps and
    of entries in int64, `success` and `diverged` in bool, `out` in float32.
    """
    yes, numbers = np.zeros(1, bool), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1, 1, 1, 0.0)
    state = (_NUMBERS, _NUMBERS, _FLAT, _FLAT, yes, yes)
    seen = (np.zeros((1, 1, 3)), _NUMBERS, _ROWS, _ROWS, 0)
    arguments = (*[_ROWS] * 5, *seen, *numbers, _NUMBERS, *state, np.zeros((1, 3), np.float32), True, 0, 1)
    return entry_point(cached(_evaluate_step, frozenset({Path(__file__)})), arguments)
