"""Cosine wind (the report's): the same force on every free particle, F_i(t) = c_i + a_i cos(p_i + f_i t), i = x, y, z.

Parameters: amplitude a [N], frequency f [rad/s], mean c [N], phase p [rad] at the start. While a simulation runs, mean, amplitude
and frequency may change, for each copy on its own; the phase goes on without a jump.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import validate
from flag_env.physics.effects.base import Setting, Wind
from flag_env.physics.jit import jit, kernel


@kernel
def _add_constant(f, value, n):
    for t in range(n):
        f[t] += value


class BoundCosineWind(NamedTuple):
    """`axes` of the scene's coordinates; (copies, 3) each: mean, amplitude [N], frequency [rad/s], phase now [rad]."""

    axes: NDArray[np.int64]
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
            i = bound.axes[d]
            angle = bound.phase[copy, i] + bound.frequency[copy, i] * lag
            wind = bound.mean[copy, i] + bound.amplitude[copy, i] * math.cos(angle)
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

    def bind(self, setting: Setting) -> BoundCosineWind:
        """One row of parameters for each copy; always float64, since a phase grows for as long as a run lasts."""
        values = (self.mean, self.amplitude, self.frequency, self.phase)
        rows = (np.tile(np.array(value), (setting.copies, 1)) for value in values)
        return BoundCosineWind(np.array(setting.lattice.axes), *rows)
