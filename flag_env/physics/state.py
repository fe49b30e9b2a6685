"""A run's state, to the bit, and how a run fails."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Diverged(FloatingPointError):  # noqa: N818  (a public name)
    """A simulation has reached numbers that are not finite.

    Attributes
    ----------
    time
        Simulated time at which it was seen [s], at most 50 steps after the first such number.
    copy
        The copy it happened to.
    particle
        (layer, row, col) of the first particle concerned.
    """

    def __init__(self, time: float, copy: int, particle: tuple[int, int, int]) -> None:
        super().__init__(time, copy, particle)
        self.time, self.copy, self.particle = time, copy, particle

    def __str__(self) -> str:
        return (
            f"copy {self.copy} diverged: particle (layer, row, col) = {self.particle} is not finite at t = {self.time:.6g} s; "
            "a smaller timestep or softer links may help"
        )


@dataclass(frozen=True)
class State:
    """Everything a continuation depends on, to the bit. Arrays lead with the copies."""

    time: float
    positions: NDArray[Any]
    velocities: NDArray[Any]
    memory: NDArray[Any]
    mast: NDArray[np.float64]
    stepped: NDArray[np.bool_]
    failed_at: NDArray[np.int64]
    failed_particle: NDArray[np.int64]
    scales: tuple[float, float]
    effects: tuple[tuple[NDArray[Any], ...], ...]

    def arrays(self) -> list[NDArray[Any]]:
        """All arrays, in the order of the fields."""
        own = [getattr(self, field.name) for field in fields(self)]
        return [array for array in own if isinstance(array, np.ndarray)] + [array for group in self.effects for array in group]

    def overwrite(self, to: list[int], other: State) -> None:
        """Write copies of `other`, those of the same number or its only one, over the copies `to` of this state.

        Raises
        ------
        ValueError
            If `other` belongs to another scene or is not finite; nothing has changed then.
        """
        count, copies = len(other.positions), len(self.positions)
        if other.positions.shape[1:] != self.positions.shape[1:] or count not in (1, copies):
            raise ValueError(f"state must have positions of shape {self.positions.shape}, got {other.positions.shape}")
        mine, theirs = self.arrays(), other.arrays()
        if [len(group) for group in self.effects] != [len(group) for group in other.effects] or any(
            a.shape[1:] != b.shape[1:] or a.dtype != b.dtype for a, b in zip(mine, theirs, strict=True)
        ):
            raise ValueError("state must come from a simulator of the same scene (pinned particles, effects and dtype)")
        source = to if count == copies else [0]
        running = [copy for copy in source if other.failed_at[copy] < 0]  # those that have stopped hold what they stopped at
        if any(b.dtype.kind == "f" and not np.isfinite(b[running]).all() for b in theirs):
            raise ValueError("state must be finite in all copies that have not diverged")
        for a, b in zip(mine, theirs, strict=True):
            a[to] = b[source]
