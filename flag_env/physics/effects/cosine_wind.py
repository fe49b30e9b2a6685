"""Cosine wind (the report's): the same force on every free particle, F_i(t) = c_i + a_i cos(p_i + f_i t), i = x, y, z.

Parameters: amplitude a [N], frequency f [rad/s], mean c [N], phase p [rad] at the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects._sums import total
from flag_env.physics.effects.base import BindContext, LinearBound
from flag_env.physics.effects.wind import Oscillation, Wind, advance_phase, oscillation_value
from flag_env.physics.lattice import Lattice


@kernel
def _add_constant(f, value, n):
    for t in range(n):
        f[t] += value


class CosineWindData(NamedTuple):
    """`axes` of the scene's coordinates, and the wind [N]."""

    axes: NDArray[np.int64]
    wind: Oscillation

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return ("wind",)

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        """Add the wind of the moment `lag` seconds on."""
        for d in range(f.shape[0]):
            wind = oscillation_value(data.wind, copy, data.axes[d], lag)
            _add_constant(f[d], f.dtype.type(wind), f.shape[1])

    @staticmethod
    def parameters() -> tuple[str, ...]:
        """What `slopes` are with respect to."""
        return "mean", "amplitude"

    @staticmethod
    @jit
    def pull_back(data, copy, x, v, g, dx, dv, effect_work, lag):
        """Nothing: the force depends on time alone."""

    @staticmethod
    @jit
    def slopes(data, copy, x, v, g, out, effect_work, lag):
        """By the mean along each axis: 1; by the amplitude: the cosine of the moment."""
        for d in range(g.shape[0]):
            i, all_free = data.axes[d], total(g[d], g.shape[1])
            out[i] += all_free
            out[3 + i] += all_free * math.cos(data.wind.phase[copy, i] + data.wind.frequency[copy, i] * lag)

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

    scales_with: ClassVar[tuple[str, ...] | None] = ("mean", "amplitude")

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
        return CosineWindData(np.array(context.lattice.axes), self.oscillation(context.copies))
