"""Gusts: a mean wind with Dryden or Ornstein-Uhlenbeck turbulence on top, carried along the flag.

    F_i = c m [U_i + a_i cos(p_i + f_i t) + g_i(t - s / V)],   i = x (longitudinal), y (lateral), z (vertical)

c rate [1/s]; m the particle's mass [kg]; U mean and a amplitude of the air's velocity [m/s], f frequency [rad/s], p phase [rad],
as in `CosineWind`; s the particle's distance from the mast along the cloth at rest [m]; V speed [m/s]. Together with `AirDrag(c)`
the force is exactly c m (air - v). The turbulence is frozen while it passes (Taylor 1938): column s sees what the mast saw s / V
ago.

g has the intensity (standard deviation) sigma [m/s] and the length scale L [m], with T = L / V and autocorrelation

    "ou", and "dryden" along x:   sigma^2 exp(-t/T)                filter  sigma sqrt(2T) / (1 + T s)
    "dryden" along y and z:       sigma^2 (1 - t/(2T)) exp(-t/T)   filter  sigma sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2

driven by white noise of unit intensity. The filters' states x1' = -x1/T + noise, x2' = (x1 - x2)/T take exact steps: transition
exp(A h) and covariance of the noise from one matrix exponential (Van Loan 1978); the statistics do not depend on the timestep h.
Between two steps g is linear. Noise: splitmix64 (Steele, Lea, Flood 2014) and Box-Muller, one stream for each copy.

Source: MIL-F-8785C (1980), 3.7.1.2 spectra, 3.7.3.2 mean wind and 3.7.3.4 scales and intensities at low altitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects.base import BindContext, LinearBound
from flag_env.physics.effects.wind import (
    Oscillation,
    Turbulence,
    Wind,
    advance_phase,
    advance_turbulence,
    filter_coefficients,
    oscillation_value,
)
from flag_env.physics.lattice import Lattice

FOOT = 0.3048
"""[m]."""


@jit
def air_of_columns(wind, turbulence, copy, i, lag, out):
    """Write the air's velocity along axis i at every column [m/s] to the start of `out`."""
    share = min(max(lag * turbulence.per_second, 0.0), 1.0)
    air = oscillation_value(wind, copy, i, lag)
    delay = turbulence.delay
    _interpolate(turbulence.history[copy, i], turbulence.head[copy, 0], delay, share, air, out, len(delay))


@kernel
def _interpolate(history, head, delay, share, air, out, n):
    length = history.shape[0]
    for c in range(n):
        age = 1.0 - share + delay[c]  # in steps; the head is the end of this step
        whole = int(age)
        part = age - whole
        newer = head - whole
        if newer < 0:
            newer += length
        older = newer - 1
        if older < 0:
            older += length
        out[c] = air + (1.0 - part) * history[newer] + part * history[older]


@kernel
def _push(f, rate, air, n):
    for t in range(n):
        f[t] += rate[t] * air[t]


class GustsData(NamedTuple):
    """A smooth wind and its turbulence.

    Attributes
    ----------
    axes
        Of the scene's coordinates.
    push : (particles,)
        Rate times mass [kg/s].
    wind
        The air's velocity but for the turbulence [m/s].
    turbulence
        See `Turbulence`.
    """

    axes: NDArray[np.int64]
    push: NDArray[Any]
    wind: Oscillation
    turbulence: Turbulence

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return "wind", "turbulence"

    def reseed(self, copy: int, seed: int) -> None:
        """Let the turbulence of a copy start anew from a seed."""
        self.turbulence.restart(copy, seed)

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        """Add rate times mass times the air's velocity, column by column."""
        cols = len(data.turbulence.delay)
        for d in range(f.shape[0]):
            air_of_columns(data.wind, data.turbulence, copy, data.axes[d], lag, effect_work[0])
            for first in range(0, f.shape[1], cols):
                _push(f[d, first:], data.push[first:], effect_work[0], cols)

    @staticmethod
    @jit
    def advance(data, copy, seconds):
        """Move the phase on and draw the next step's turbulence."""
        advance_phase(data.wind, copy, seconds)
        advance_turbulence(data.turbulence, copy)


@dataclass(frozen=True)
class Gusts(Wind):
    """A turbulent wind that pushes every particle in proportion to its mass.

    Parameters
    ----------
    intensity
        Standard deviation of the turbulence, one number or (x, y, z) [m/s], >= 0.
    scale
        Its length scale, one number or (x, y, z) [m], > 0.
    speed
        Speed at which the turbulence passes the mast and goes along the flag [m/s], > 0; that of the mean wind, as a rule. It
        stays the same when a run changes the mean.
    mean
        Mean velocity of the air (x, y, z) [m/s].
    rate
        Velocity that still air would take from a particle, per second [1/s], >= 0: give `AirDrag` the same.
    spectrum
        "dryden", or "ou": Ornstein-Uhlenbeck along all axes.
    amplitude, frequency, phase
        Of a swinging part, as in `CosineWind`: (x, y, z) [m/s], [rad/s], [rad].
    """

    wind_unit: ClassVar[str | None] = "m/s"

    intensity: float | tuple[float, ...] = 1.0
    scale: float | tuple[float, ...] = 5.0
    speed: float = 6.0
    mean: tuple[float, ...] = (6.0, 0.0, 0.0)
    rate: float = 1.5
    spectrum: str = "dryden"
    amplitude: tuple[float, ...] = (0.0, 0.0, 0.0)
    frequency: tuple[float, ...] = (0.0, 0.0, 0.0)
    phase: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("intensity", "scale"):
            value = getattr(self, name)
            several = isinstance(value, (tuple, list)) or np.ndim(value) > 0
            triple = _validate.vector(name, value if several else (value,) * 3)
            if min(triple) < 0 or (name == "scale" and min(triple) == 0):
                raise ValueError(f"{name} must be {'> 0' if name == 'scale' else '>= 0'} along every axis, got {value!r}")
            object.__setattr__(self, name, triple)
        object.__setattr__(self, "speed", _validate.number("speed", self.speed, above=0.0))
        object.__setattr__(self, "rate", _validate.number("rate", self.rate, minimum=0.0))
        _validate.choice("spectrum", self.spectrum, ("dryden", "ou"))

    @property
    def smooth(self) -> bool:
        """Every timestep draws a turbulence of its own; without intensity there is none."""
        return not np.any(self.intensity)

    @classmethod
    def low_altitude(cls, height: float, wind: float, rate: float = 1.5) -> Gusts:
        """Dryden turbulence of MIL-F-8785C near the ground, in a mean wind along x.

        With h in feet: intensity of the vertical axis 0.1 W, of the others that / (0.177 + 0.000823 h)^0.4; scale h and
        h / (0.177 + 0.000823 h)^1.2; mean wind W ln(h / 0.15) / ln(20 / 0.15).

        Parameters
        ----------
        height
            Above the ground h [m]; 10 ft to 1000 ft, 3.048 m to 304.8 m.
        wind
            Mean wind at 20 ft W [m/s], > 0.
        rate
            As for `Gusts`.
        """
        feet = _validate.number("height", height, minimum=10 * FOOT, maximum=1000 * FOOT) / FOOT
        wind = _validate.number("wind", wind, above=0.0)
        ratio = 0.177 + 0.000823 * feet
        vertical, level = 0.1 * wind, 0.1 * wind / ratio**0.4
        long, tall = feet / ratio**1.2 * FOOT, feet * FOOT
        speed = wind * math.log(feet / 0.15) / math.log(20 / 0.15)
        return cls((level, level, vertical), (long, long, tall), speed, (speed, 0.0, 0.0), rate)

    def check(self, lattice: Lattice) -> None:
        """A rope in one dimension has no coordinate along the wind."""
        if lattice.dimensions == 1:
            raise ValueError(f"{type(self).__name__} needs a lattice of dimensions 2 or 3, got 1")

    def turbulence(self, context: BindContext) -> Turbulence:
        """The turbulence of every copy as if it had blown for ever: filters, their states and the mast's past."""
        lattice, h = context.lattice, context.timestep
        delay = np.arange(lattice.cols) * lattice.spacings[0] / (self.speed * h)
        coefficients = np.stack(
            [
                filter_coefficients(h * self.speed / length, self.spectrum == "dryden" and axis > 0, sigma)
                for axis, (sigma, length) in enumerate(zip(self.intensity, self.scale, strict=True))  # type: ignore[arg-type]
            ]
        )
        length = math.ceil(delay[-1]) + 3
        copies, number = context.copies, context.dtype.type
        turbulence = Turbulence(
            delay=delay.astype(context.dtype),
            per_second=number(1.0 / h),
            filter=np.tile(coefficients, (copies, 1, 1)),
            level=np.empty((copies, 3, 2)),
            history=np.empty((copies, 3, length)),
            head=np.empty((copies, 1), np.int64),
            generator=np.empty((copies, 1), np.uint64),
        )
        for copy in range(copies):
            turbulence.restart(copy, context.seed, copy)
        return turbulence

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """A force that depends on time alone adds nothing."""
        del lattice
        return LinearBound()

    def bind(self, context: BindContext) -> GustsData:
        """Air and turbulence in float64, forces in the scene's dtype."""
        push = (self.rate * context.lattice.masses).astype(context.dtype)
        return GustsData(np.array(context.lattice.axes), push, self.oscillation(context.copies), self.turbulence(context))
