"""How a run is divided: into actions, into legs of steps, and into segments of legs whose steps are kept at the same time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Plan(NamedTuple):
    """Steps of a run.

    Attributes
    ----------
    counts
        Steps of each action.
    segments
        Legs of each segment, (legs, 5) each; see `flag_env.physics.compiling.back.make_record`.
    """

    counts: list[int]
    segments: list[NDArray[np.int64]]

    @property
    def rows(self) -> tuple[int, int]:
        """Largest number of positions and of velocities that a segment keeps."""
        sums = [(int(legs[:, 0].sum()), len(legs)) for legs in self.segments]
        return max(steps + legs for steps, legs in sums), max(steps + 2 * legs for steps, legs in sums)


def steps_of(actions: int, seconds: float, timestep: float, remainder: float) -> list[int]:
    """Whole steps of each action, as `Simulator.advance` takes them.

    Raises
    ------
    ValueError
        If an action would take none.
    """
    counts = []
    for _ in range(actions):
        remainder += seconds / actions
        steps = round(remainder / timestep)
        if steps < 1:
            raise ValueError(
                f"seconds must give each of {actions} actions a step of {timestep:.6g} s at least, got {seconds / actions:.6g} s "
                "for each"
            )
        remainder -= steps * timestep
        counts.append(steps)
    return counts


def plan(counts: list[int], capacity: int) -> Plan:
    """Divide the steps of each action into segments of at most `capacity` steps, or as many as the root of all of them."""
    total = sum(counts)
    longest = max(capacity, math.isqrt(total - 1) + 1)
    segments: list[list[tuple[int, ...]]] = [[]]
    free, taken = longest, 0
    for action, count in enumerate(counts):
        left = count
        while left:
            if not free:
                segments.append([])
                free = longest
            steps = min(left, free)
            segments[-1].append((steps, action, count if left == count else 0, int(steps == left), taken))
            left, free, taken = left - steps, free - steps, taken + steps
    return Plan(counts, [np.array(legs, np.int64) for legs in segments])
