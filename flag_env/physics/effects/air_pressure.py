"""Air pressure: what a wind does to every triangle of the cloth, from the air's velocity relative to the moving cloth.

    F = rho A / 2 { C_N |u| (u.n) n  +  C_L (u.n) (|u| n - (u.n) u/|u|)  +  C_F |u| (u - (u.n) n) }

u velocity of the air relative to the mean of the triangle's corners [m/s]; n unit normal, whose sign cancels; A area [m^2]; rho
density of the air [kg/m^3]. The terms: C_N pressure along the normal, like u^2 across the stream, proportional to the angle in a
glancing one; C_L lift, perpendicular to the stream; C_F friction along the cloth, both sides together. Every corner takes a third
of F. A cell of the lattice is two triangles, (t, t + 1, t + cols + 1) and (t, t + cols + 1, t + cols). Several layers bear equal
shares: together they are one sheet in the air. The air does not feel the cloth: no wake, no added mass. A cell with a torn
side is no cloth and feels no air.

Where |u| A exceeds `max_speed` times the triangle's area at rest, F is that of |u| A at this bound: from there on it grows like
u, not like u^2. So the damping stays below what the step limit counts with, however fast the air and however large the triangle.

Still air only takes energy out: the lift does no work along u, the other terms oppose the motion.

C_N = 1.2 is a square plate's drag across the stream (Hoerner, Fluid-Dynamic Drag, 1965, 3-16), and within 20 % the slope of the
normal force of a wing as short as a flag, 2 pi AR / (2 + sqrt(4 + AR^2)) for a height/length AR of 2/3 to 1 (Helmbold 1942): so
C_L = 0 by default. C_F = 0.01 is a turbulent layer on both sides at a Reynolds number of 10^6 (Schlichting, Boundary-Layer
Theory).
Source: Ling, Damodaran, Gay 1996 (lift and drag of cloth panels); Wejchert, Haumann 1991 (normal and tangential parts).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects.base import BindContext, LinearBound
from flag_env.physics.effects.gusts import Gusts, air_of_columns
from flag_env.physics.effects.links import sides_of
from flag_env.physics.effects.wind import (
    TINY,
    Cloth,
    Oscillation,
    TearingCloth,
    Turbulence,
    Wind,
    advance_phase,
    advance_turbulence,
    oscillation_value,
    press,
)
from flag_env.physics.lattice import Lattice


@kernel
def _relative(v, air, out, n):
    for t in range(n):
        out[t] = air - v[t]


@kernel
def _relative_of_columns(v, air, out, n):
    for t in range(n):
        out[t] = air[t] - v[t]


class AirPressureData(NamedTuple):
    """A cloth in a smooth wind [m/s]."""

    cloth: Cloth | TearingCloth
    wind: Oscillation

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return ("wind",)

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        """Add the pressure of an air that is the same everywhere."""
        for d in range(3):
            _relative(v[d], f.dtype.type(oscillation_value(data.wind, copy, d, lag)), effect_work[d], x.shape[1])
        press(data.cloth, copy, x, effect_work, f)

    @staticmethod
    @jit
    def advance(data, copy, seconds):
        """Move the phase on."""
        advance_phase(data.wind, copy, seconds)


class GustyAirPressureData(NamedTuple):
    """A cloth in a turbulent wind [m/s]."""

    cloth: Cloth | TearingCloth
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
        """Add the pressure of an air that differs from column to column."""
        cols, air = data.cloth.cols, data.cloth.work[copy, 0]
        for d in range(3):
            air_of_columns(data.wind, data.turbulence, copy, d, lag, air)
            for first in range(0, x.shape[1], cols):
                _relative_of_columns(v[d, first:], air, effect_work[d, first:], cols)
        press(data.cloth, copy, x, effect_work, f)

    @staticmethod
    @jit
    def advance(data, copy, seconds):
        """Move the phase on and draw the next step's turbulence."""
        advance_phase(data.wind, copy, seconds)
        advance_turbulence(data.turbulence, copy)


@dataclass(frozen=True)
class AirPressure(Wind):
    """Pressure, lift and friction of a wind on the cloth's triangles, in three dimensions.

    Parameters
    ----------
    mean
        Mean velocity of the air (x, y, z) [m/s].
    amplitude, frequency, phase
        Of a swinging part, as in `CosineWind`: (x, y, z) [m/s], [rad/s], [rad].
    density
        Of the air [kg/m^3], >= 0.
    normal, lift, friction
        Coefficients C_N, C_L, C_F, >= 0.
    max_speed
        Speed of the air relative to the cloth up to which the force grows like its square [m/s], > 0; beyond it, or where
        a triangle is larger than at rest by as much, like the speed. The step limit falls as this grows. The wind's mean and
        amplitude must stay below it.
    gusts
        Turbulence of the air; only its intensity, scale, speed and spectrum count. None: a smooth wind.
    """

    wind_unit: ClassVar[str | None] = "m/s"

    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    amplitude: tuple[float, ...] = (0.0, 0.0, 0.0)
    frequency: tuple[float, ...] = (0.0, 0.0, 0.0)
    phase: tuple[float, ...] = (0.0, 0.0, 0.0)
    density: float = 1.2
    normal: float = 1.2
    lift: float = 0.0
    friction: float = 0.01
    max_speed: float = 20.0
    gusts: Gusts | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("density", "normal", "lift", "friction"):
            object.__setattr__(self, name, _validate.number(name, getattr(self, name), minimum=0.0))
        object.__setattr__(self, "max_speed", _validate.number("max_speed", self.max_speed, above=0.0))
        self.check_wind(np.array(self.mean), np.array(self.amplitude))
        if self.gusts is not None and not isinstance(self.gusts, Gusts):
            raise TypeError(f"gusts must be a Gusts or None, got {self.gusts!r}")

    @property
    def smooth(self) -> bool:
        """Unless the air is turbulent."""
        return self.gusts is None or self.gusts.smooth

    def check(self, lattice: Lattice) -> None:
        """Triangles need three dimensions, two rows and two columns."""
        if lattice.dimensions != 3 or min(lattice.rows, lattice.cols) < 2:
            raise ValueError(
                f"AirPressure needs a lattice of dimensions 3 with at least 2 rows and 2 columns, got {lattice.dimensions} "
                f"with {lattice.rows} rows and {lattice.cols} columns"
            )

    def check_wind(self, mean: NDArray[np.float64], amplitude: NDArray[np.float64]) -> None:
        """Raise ValueError where mean and amplitude (..., 3) together exceed `max_speed`."""
        speed = float(np.linalg.norm(np.abs(mean) + np.abs(amplitude), axis=-1).max())
        if speed > self.max_speed:
            raise ValueError(
                f"mean and amplitude of the air must stay within max_speed = {self.max_speed:g} m/s, got {speed:g} m/s; make the "
                "scene with a larger one, as in AirPressure(max_speed=...)"
            )

    def cells(self, lattice: Lattice) -> NDArray[np.bool_]:
        """Whether a particle is the first of a cell, shape (particles - cols - 1,)."""
        _, row, col = np.indices(lattice.shape).reshape(3, -1)
        present = (row < lattice.rows - 1) & (col < lattice.cols - 1)
        return np.asarray(present[: lattice.size - lattice.cols - 1])

    def drag(self, lattice: Lattice) -> NDArray[np.float64]:
        """Bound of each particle's damping [N s/m], shape (particles,).

        |u| A counts up to max_speed times the area at rest. Of the terms' slopes d/du, those of C_N and C_F together are at most
        2 max(C_N, C_F) |u|, attained across the stream; the symmetric part of that of C_L is at most C_L |u|. A triangle's
        damping acts through the mean of its corners' velocities: a third of it on each corner bounds it. The change of the force
        as a triangle turns is no damping: the limit ignores it.
        """
        slope = 2.0 * max(self.normal, self.friction) + self.lift
        along, up, _ = lattice.spacings
        corner = 0.5 * self.density / lattice.layers * (0.5 * along * up) * slope * self.max_speed / 3.0
        cells = corner * self.cells(lattice)
        result = np.zeros(lattice.size)
        for offset, triangles in ((0, 2), (1, 1), (lattice.cols, 1), (lattice.cols + 1, 2)):
            result[offset : offset + len(cells)] += triangles * cells
        return result

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """The drag, which depends on the direction of the air."""
        return LinearBound(drag=self.drag(lattice))

    def coarsened(self, share: float) -> AirPressure:
        """Pressure on an area is the same however many particles carry it."""
        del share
        return self

    def bind(self, context: BindContext) -> AirPressureData | GustyAirPressureData:
        """Air in float64, weights and constants in the scene's dtype."""
        lattice, dtype = context.lattice, context.dtype
        weight = (self.density / 12.0 / lattice.layers * self.cells(lattice)).astype(dtype)
        along = self.normal + self.lift - self.friction
        beyond = min(1.0 / (self.max_speed * lattice.spacings[0] * lattice.spacings[1]), float(np.finfo(dtype).max))
        constants = np.array([1.0 / 3.0, along, self.friction, self.lift, TINY, beyond], dtype)
        work = np.zeros((context.copies, 6, lattice.size), dtype)
        wind = self.oscillation(context.copies)
        sides = sides_of(context.links) if context.breaks else None
        if sides is None:
            cloth: Cloth | TearingCloth = Cloth(lattice.cols, weight[None], constants, work)
        else:
            cloth = TearingCloth(lattice.cols, np.tile(weight, (context.copies, 1)), constants, work, weight, sides)
        if self.gusts is None:
            return AirPressureData(cloth, wind)
        return GustyAirPressureData(cloth, wind, self.gusts.turbulence(context))
