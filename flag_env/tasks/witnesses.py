"""How witnesses are drawn at random: actions from which targets are made.

A sampler takes a generator and the number of entries of an action, and gives the knots (knots, size) of one witness and the
number of steps of each. With a single span, the whole episode, the knots are evenly spread over it and joined by a cubic spline.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Sampler = Callable[[np.random.Generator, int], tuple[NDArray[np.float64], tuple[int, ...]]]


@dataclass(frozen=True)
class Strokes:
    """Set-points drawn evenly from [-1, 1], each held for its number of steps, then `rest` steps of no action."""

    spans: tuple[int, ...]
    rest: int = 0

    def __call__(self, rng: np.random.Generator, size: int) -> tuple[NDArray[np.float64], tuple[int, ...]]:
        """One witness."""
        knots = rng.uniform(-1.0, 1.0, (len(self.spans), size))
        return (np.vstack([knots, np.zeros(size)]), (*self.spans, self.rest)) if self.rest else (knots, self.spans)


@dataclass(frozen=True)
class Spline:
    """So many set-points drawn evenly from [-1, 1], joined by a cubic spline, which is clipped there."""

    knots: int
    steps: int

    def __call__(self, rng: np.random.Generator, size: int) -> tuple[NDArray[np.float64], tuple[int, ...]]:
        """One witness."""
        return rng.uniform(-1.0, 1.0, (self.knots, size)), (self.steps,)


def unrolled(knots: NDArray[np.float32], spans: NDArray[np.int64]) -> NDArray[np.float32]:
    """Actions (steps, size) from the knots (knots, size) of a witness and their spans."""
    if len(spans) == len(knots):
        return np.repeat(knots, spans, axis=0)
    steps = int(spans.sum())
    smooth = CubicSpline(np.linspace(0.0, steps - 1.0, len(knots)), knots.astype(np.float64))
    return np.clip(smooth(np.arange(steps)), -1.0, 1.0).astype(np.float32)
