"""A run's recent past: the state some steps ago, from which the steps of a copy that fails are taken again one by one.

A run looks for bad numbers every 50 steps; by then a single one has spread over the whole cloth. Which particle went first, and
when, is seen by going back.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.compiling import CHECK_EVERY

_EVERY = 1000
"""Steps between two states that are kept: copying one takes as long as about one step."""

_UNKNOWN = 2**62
"""Steps since a state that is none, or of another motion."""


class Past:
    """The arrays of a run some steps ago.

    Parameters
    ----------
    arrays
        All that a step of the run changes, each with a leading copies axis; x and v first.

    Attributes
    ----------
    steps
        Steps taken since, without anything having been set.
    """

    def __init__(self, arrays: list[NDArray[Any]]) -> None:
        self.steps = _UNKNOWN
        self._arrays, self._kept = arrays, [np.empty_like(array) for array in arrays]

    def forget(self) -> None:
        """What is kept does not lead to the present: something has been set."""
        self.steps = _UNKNOWN

    def before(self, steps: int) -> None:
        """Note that `steps` steps are about to be taken; keep the run's arrays if need be."""
        if self.steps >= _EVERY:
            for kept, array in zip(self._kept, self._arrays, strict=True):
                kept[...] = array
            self.steps = 0
        self.steps += steps

    def first(self, copy: int, late: int, go: Callable[[int], int]) -> tuple[int, int] | None:
        """How many steps before the present a copy has first had a bad number, and the particle; None if that is not known.

        Parameters
        ----------
        copy
            The copy that has failed.
        late
            How many steps before the present it was seen.
        go
            Takes that many steps of the copy; returns the particle with a bad number, or -1. The run's arrays are the same
            afterwards.
        """
        if self.steps >= _UNKNOWN:
            return None
        arrays, seen = self._arrays, self.steps - late
        end = [array[copy].copy() for array in arrays]
        for array, kept in zip(arrays, self._kept, strict=True):
            array[copy] = kept[copy]
        try:
            bad = np.flatnonzero(~(np.isfinite(arrays[0][copy]) & np.isfinite(arrays[1][copy])).all(axis=0))
            if len(bad):  # a bad number was put there
                return self.steps - 1, int(bad[0])
            done = max(seen - CHECK_EVERY, 0)
            if done and go(done) >= 0:
                return None
            while done < seen:
                done += 1
                if (particle := go(1)) >= 0:
                    return self.steps - done, particle
            return None
        finally:
            for array, last in zip(arrays, end, strict=True):
                array[copy] = last
