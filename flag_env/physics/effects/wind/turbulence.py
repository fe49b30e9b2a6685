"""Turbulence in time: exact steps of the Dryden and Ornstein-Uhlenbeck filters; `Gusts` tells their formulas."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from flag_env.physics.compiling import jit

_GOLDEN, _MIX_1, _MIX_2 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)
_ULP = 2.0**-53

_STREAM = 0x67757374
"""Keeps the turbulence's stream apart from the one that a copy's start is drawn from."""

_STATIONARY = np.linalg.cholesky(np.array([[0.5, 0.25], [0.25, 0.25]]))
"""Root of the covariance of (x1, x2) in units of sqrt(T)."""


class Turbulence(NamedTuple):
    """Turbulence at the mast, which every column sees later.

    Attributes
    ----------
    delay : (cols,)
        How much later than the mast a column sees a gust [steps].
    per_second
        Steps in a second.
    filter : (copies, 3, 8)
        Transition p11, p21, p22, noise n11, n21, n22 and output o1, o2 of each axis.
    level : (copies, 3, 2)
        The filters' states.
    history : (copies, 3, length)
        Ring of the turbulence at the mast [m/s].
    head : (copies, 1)
        Where in the ring the end of the present step is.
    generator : (copies, 1)
        State of each copy's stream.
    """

    delay: NDArray[Any]
    per_second: Any
    filter: NDArray[np.float64]
    level: NDArray[np.float64]
    history: NDArray[np.float64]
    head: NDArray[np.int64]
    generator: NDArray[np.uint64]

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes or that a copy may have its own of."""
        return "filter", "level", "history", "head", "generator"

    def restart(self, copy: int, seed: int, stream: int = 0) -> None:
        """Let the turbulence of a copy be as if it had blown for ever, drawn from the stream (seed, stream)."""
        random = np.random.default_rng((seed, stream, _STREAM))
        length = self.history.shape[2]
        self.generator[copy] = random.integers(2**64, dtype=np.uint64)
        for axis, coefficients in enumerate(self.filter[copy]):
            past = stationary_past(coefficients, random.standard_normal((2, length)))
            self.level[copy, axis] = past[:, -1]
            self.history[copy, axis] = coefficients[6:] @ past
        self.head[copy] = length - 1


@jit
def _uniform(generator, copy):
    """Next number of a copy's stream, 0 <= number < 1 (splitmix64)."""
    z = generator[copy, 0] + _GOLDEN
    generator[copy, 0] = z
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return np.float64((z ^ (z >> _S31)) >> _S11) * _ULP


@jit
def advance_turbulence(turbulence, copy):
    """Draw the turbulence of the next step and move the ring's head on to it."""
    head = (turbulence.head[copy, 0] + 1) % turbulence.history.shape[2]
    for i in range(3):
        radius = math.sqrt(-2.0 * math.log(1.0 - _uniform(turbulence.generator, copy)))
        angle = 2.0 * math.pi * _uniform(turbulence.generator, copy)
        e1, e2 = radius * math.cos(angle), radius * math.sin(angle)
        c, level = turbulence.filter[copy, i], turbulence.level[copy, i]
        level[1] = c[1] * level[0] + c[2] * level[1] + c[4] * e1 + c[5] * e2
        level[0] = c[0] * level[0] + c[3] * e1
        turbulence.history[copy, i, head] = c[6] * level[0] + c[7] * level[1]
    turbulence.head[copy, 0] = head


def filter_coefficients(step: float, lateral: bool, intensity: float) -> NDArray[np.float64]:
    """Exact transition, noise and output (p11, p21, p22, n11, n21, n22, o1, o2) of a filter for a step in units of T."""
    # x2 is scaled by 1/step, the noise by 1/sqrt(step): every entry is of order one, and none is lost however short the step
    system = np.array([[-step, 0.0], [1.0, -step]])
    transition = scipy.linalg.expm(system)
    if step < 1.0:
        block = scipy.linalg.expm(np.block([[-system, np.diag([1.0, 0.0])], [np.zeros((2, 2)), system.T]]))
        covariance = transition @ block[:2, 2:]
    else:  # where the block would overflow nothing cancels
        kept = _STATIONARY @ _STATIONARY.T / np.outer([1.0, step], [1.0, step]) / step
        covariance = kept - transition @ kept @ transition.T
    noise = math.sqrt(step) * np.linalg.cholesky(0.5 * (covariance + covariance.T))
    output = (math.sqrt(3.0), 1.0 - math.sqrt(3.0)) if lateral else (math.sqrt(2.0), 0.0)
    return np.array(
        [transition[0, 0], step * transition[1, 0], transition[1, 1], noise[0, 0], step * noise[1, 0], step * noise[1, 1]]
        + [intensity * weight for weight in output]
    )


def stationary_past(coefficients: ArrayLike, noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stationary states (2, length) of a filter driven by `noise`: two recursions, each a bidiagonal system."""
    p11, p21, p22, n11, n21, n22, *_ = np.asarray(coefficients)
    start = _STATIONARY @ noise[:, 0]
    first, second = n11 * noise[0], n21 * noise[0] + n22 * noise[1]
    first[0] = start[0]
    first = _recursion(p11, first)
    second[0] = start[1]
    second[1:] += p21 * first[:-1]
    return np.stack([first, _recursion(p22, second)])


def _recursion(factor: float, drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """y[k] = factor y[k-1] + drive[k]."""
    bands = np.ones((2, len(drive)))
    bands[1] = -factor
    return np.asarray(scipy.linalg.solve_banded((1, 0), bands, drive))
