"""Cosine wind (the report's): the same force on every free particle, F_i(t) = c_i + a_i cos(p_i + f_i t), i = x, y, z.

Parameters: amplitude a [N], frequency f [rad/s], mean c [N], phase p [rad] at the start. While a simulation runs, mean, amplitude
and frequency may change, for each copy on its own; the phase goes on without a jump.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import validate
from flag_env.physics.effects.base import Wind
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Lattice


@kernel
def _add_constant(f, value, n):
    for t in range(n):
        f[t] += value


class BoundCosineWind(NamedTuple):
    """All (copies, 3): mean and amplitude [N], frequency [rad/s], phase now [rad]."""

    mean: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    frequency: NDArray[np.float64]
    phase: NDArray[np.float64]

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return "mean", "amplitude", "frequency", "phase"

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Add the wind of the moment `lag` seconds on."""
        for d in range(f.shape[0]):
            angle = bound.phase[copy, d] + bound.frequency[copy, d] * lag
            wind = bound.mean[copy, d] + bound.amplitude[copy, d] * math.cos(angle)
            _add_constant(f[d], f.dtype.type(wind), f.shape[1])

    @staticmethod
    @jit
    def advance(bound, copy, seconds):
        """Move the phase on."""
        for d in range(bound.phase.shape[1]):
            bound.phase[copy, d] += bound.frequency[copy, d] * seconds


@dataclass(frozen=True)
class CosineWind(Wind):
    """A uniform wind force that swings as a cosine along each axis.

    Parameters
    ----------
    amplitude
        (x, y, z) [N].
    frequency
        (x, y, z) [rad/s].
    mean
        (x, y, z) [N].
    phase
        (x, y, z) at the start [rad].
    """

    amplitude: tuple[float, ...] = (0.0, 0.0, 0.0)
    frequency: tuple[float, ...] = (0.0, 0.0, 0.0)
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    phase: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("amplitude", "frequency", "mean", "phase"):
            object.__setattr__(self, name, validate.vector(name, getattr(self, name)))

    def bind(self, lattice: Lattice, dtype: np.dtype[Any], copies: int) -> BoundCosineWind:
        """One row of parameters for each copy; always float64, since a phase grows for as long as a run lasts."""
        del lattice, dtype
        rows = (np.tile(np.array(values), (copies, 1)) for values in (self.mean, self.amplitude, self.frequency, self.phase))
        return BoundCosineWind(*rows)
