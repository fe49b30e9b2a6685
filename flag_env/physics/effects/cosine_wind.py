"""Cosine wind (the report's): the same force on every free particle, F_i(t) = c_i + a_i cos(p_i + f_i t), i = x, y, z.

Parameters: amplitude a [N], frequency f [rad/s], mean c [N], phase p [rad] at the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.effects.base import Setting
from flag_env.physics.effects.wind import Swing, Wind, swing_on, swing_value
from flag_env.physics.jit import jit, kernel


@kernel
def _add_constant(f, value, n):
    for t in range(n):
        f[t] += value


class BoundCosineWind(NamedTuple):
    """`axes` of the scene's coordinates, and the wind [N]."""

    axes: NDArray[np.int64]
    wind: Swing

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return ("wind",)

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Add the wind of the moment `lag` seconds on."""
        for d in range(f.shape[0]):
            wind = swing_value(bound.wind, copy, bound.axes[d], lag)
            _add_constant(f[d], f.dtype.type(wind), f.shape[1])

    @staticmethod
    @jit
    def advance(bound, copy, seconds):
        """Move the phase on."""
        swing_on(bound.wind, copy, seconds)


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

    def bind(self, setting: Setting) -> BoundCosineWind:
        """Axes, and one row of the wind for each copy."""
        return BoundCosineWind(np.array(setting.lattice.axes), self.swing(setting.copies))
