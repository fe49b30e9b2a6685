"""Cosine wind (the report's): the same force on every free particle, F_i(t) = c_i + a_i cos(p_i + f_i t), i = x, y, z.

Parameters: amplitude a [N], frequency f [rad/s], mean c [N], phase p [rad] at the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects.base import BindContext, LinearBound
from flag_env.physics.effects.wind import Swing, Wind, advance_phase, swing_value
from flag_env.physics.lattice import Lattice


@kernel
def _add_constant(f, value, n):
    for t in range(n):
        f[t] += value


class CosineWindData(NamedTuple):
    """`axes` of the scene's coordinates, and the wind [N]."""

    axes: NDArray[np.int64]
    wind: Swing

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return ("wind",)

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        """Add the wind of the moment `lag` seconds on."""
        for d in range(f.shape[0]):
            wind = swing_value(data.wind, copy, data.axes[d], lag)
            _add_constant(f[d], f.dtype.type(wind), f.shape[1])

    @staticmethod
    @jit
    def advance(data, copy, seconds):
        """Move the phase on."""
        advance_phase(data.wind, copy, seconds)


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

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """A force that depends on time alone adds nothing."""
        del lattice
        return LinearBound()

    def coarsened(self, share: float) -> CosineWind:
        """Fewer particles, each with a larger force."""
        mean, amplitude = (tuple(1.0 / share * entry for entry in value) for value in (self.mean, self.amplitude))
        return replace(self, mean=mean, amplitude=amplitude)

    def bind(self, context: BindContext) -> CosineWindData:
        """Axes, and one row of the wind for each copy."""
        return CosineWindData(np.array(context.lattice.axes), self.swing(context.copies))
