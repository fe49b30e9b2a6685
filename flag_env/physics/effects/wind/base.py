"""What winds share: a force or a velocity of the air that swings about its mean, the same everywhere.

    w_i(t) = c_i + a_i cos(p_i + f_i t),   i = x, y, z

c mean and a amplitude, in the wind's unit; f frequency [rad/s]; p phase at the start [rad]. While a simulation runs, mean,
amplitude and frequency may change, for each copy on its own; the phase goes on without a jump.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit
from flag_env.physics.effects.base import Effect


class Oscillation(NamedTuple):
    """A wind now, (copies, 3) each; float64, since a phase grows for as long as a run lasts."""

    mean: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    frequency: NDArray[np.float64]
    phase: NDArray[np.float64]

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return "mean", "amplitude", "frequency", "phase"


@jit
def oscillation_value(oscillation, copy, i, lag):
    """The wind along axis i, `lag` seconds on."""
    angle = oscillation.phase[copy, i] + oscillation.frequency[copy, i] * lag
    return oscillation.mean[copy, i] + oscillation.amplitude[copy, i] * math.cos(angle)


@jit
def advance_phase(oscillation, copy, seconds):
    """Move the phase on."""
    for i in range(oscillation.phase.shape[1]):
        oscillation.phase[copy, i] += oscillation.frequency[copy, i] * seconds


class Wind(Effect):
    """An effect with a wind that a run may change: its bound form has a `Oscillation` called `wind`.

    Attributes
    ----------
    wind_unit
        Of mean and amplitude: "N", a force on every free particle, or "m/s", a velocity of the air.
    mean, amplitude
        (x, y, z), in that unit.
    frequency, phase
        (x, y, z) [rad/s], and at the start [rad].
    """

    wind_unit: ClassVar[str | None] = "N"

    mean: tuple[float, ...]
    amplitude: tuple[float, ...]
    frequency: tuple[float, ...]
    phase: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in Oscillation._fields:
            object.__setattr__(self, name, _validate.vector(name, getattr(self, name)))

    def oscillation(self, copies: int) -> Oscillation:
        """The wind at the start, a row for each copy."""
        return Oscillation(*(np.tile(np.array(getattr(self, name)), (copies, 1)) for name in Oscillation._fields))
