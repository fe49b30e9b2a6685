"""Air pressure: what a wind does to every triangle of the cloth, from the air's velocity relative to the moving cloth.

    F = rho A / 2 { C_N |u| (u.n) n  +  C_L (u.n) (|u| n - (u.n) u/|u|)  +  C_F |u| (u - (u.n) n) }

u velocity of the air relative to the mean of the triangle's corners [m/s]; n unit normal, whose sign cancels; A area [m^2]; rho
density of the air [kg/m^3]. The terms: C_N pressure along the normal, like u^2 across the stream, proportional to the angle in a
glancing one; C_L lift, perpendicular to the stream; C_F friction along the cloth, both sides together. Every corner takes a third
of F. A cell of the lattice is two triangles, (t, t + 1, t + cols + 1) and (t, t + cols + 1, t + cols). Several layers bear equal
shares: together they are one sheet in the air. The air does not feel the cloth: no wake, no added mass.

Still air only takes energy out: the lift does no work along u, the other terms oppose the motion.

C_N = 1.2 is a square plate's drag across the stream (Hoerner, Fluid-Dynamic Drag, 1965, 3-16), and within 20 % the slope of the
normal force of a wing as short as a flag, 2 pi AR / (2 + sqrt(4 + AR^2)) for a height/length AR of 2/3 to 1 (Helmbold 1942): so
C_L = 0 unless told. C_F = 0.01 is a turbulent layer on both sides at a Reynolds number of 10^6 (Schlichting, Boundary-Layer
Theory).
Source: Ling, Damodaran, Gay 1996 (lift and drag of cloth panels); Wejchert, Haumann 1991 (normal and tangential parts).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import validate
from flag_env.physics.effects.base import Setting
from flag_env.physics.effects.gusts import Gusts, air_of_columns
from flag_env.physics.effects.turbulence import Turbulence, advance_turbulence
from flag_env.physics.effects.wind import Swing, Wind, swing_on, swing_value
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Lattice

TINY = 1e-30
"""Added to |u|^2 |2 A n|^2 [m^6/s^2]: keeps a triangle without area or wind finite."""


@kernel
def _relative(v, air, out, n):
    for t in range(n):
        out[t] = air - v[t]


@kernel
def _relative_of_columns(v, air, out, n):
    for t in range(n):
        out[t] = air[t] - v[t]


@kernel
def _pressure(
    xa, ya, za, xb, yb, zb, xc, yc, zc, xd, yd, zd, ua, va, wa, ub, vb, wb, uc, vc, wc, ud, vd, wd,
    weight, third, along, friction, lift, tiny, fx, fy, fz, gx, gy, gz, n,
):  # fmt: skip
    """A third of the forces on the triangles abc (f) and acd (g) of every cell."""
    for t in range(n):
        cx, cy, cz = xc[t] - xa[t], yc[t] - ya[t], zc[t] - za[t]
        sx, sy, sz = ua[t] + uc[t], va[t] + vc[t], wa[t] + wc[t]

        bx, by, bz = xb[t] - xa[t], yb[t] - ya[t], zb[t] - za[t]
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx  # 2 A n
        ux, uy, uz = third * (sx + ub[t]), third * (sy + vb[t]), third * (sz + wb[t])
        nn = nx * nx + ny * ny + nz * nz
        uu = ux * ux + uy * uy + uz * uz
        un = ux * nx + uy * ny + uz * nz
        q = weight[t] / np.sqrt(nn * uu + tiny)
        p = q * along * uu * un
        s = q * (friction * nn * uu - lift * un * un)
        fx[t], fy[t], fz[t] = p * nx + s * ux, p * ny + s * uy, p * nz + s * uz

        bx, by, bz = xd[t] - xa[t], yd[t] - ya[t], zd[t] - za[t]
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        ux, uy, uz = third * (sx + ud[t]), third * (sy + vd[t]), third * (sz + wd[t])
        nn = nx * nx + ny * ny + nz * nz
        uu = ux * ux + uy * uy + uz * uz
        un = ux * nx + uy * ny + uz * nz
        q = weight[t] / np.sqrt(nn * uu + tiny)
        p = q * along * uu * un
        s = q * (friction * nn * uu - lift * un * un)
        gx[t], gy[t], gz[t] = p * nx + s * ux, p * ny + s * uy, p * nz + s * uz


@kernel
def _add(f, g, n):
    for t in range(n):
        f[t] += g[t]


@kernel
def _add_both(f, g, h, n):
    for t in range(n):
        f[t] += g[t] + h[t]


@jit
def _press(cloth, copy, x, u, f):
    """Add the forces of all cells, given the air's velocity relative to every particle."""
    o, w, c = cloth.cols, cloth.work[copy], cloth.constants
    n = x.shape[1] - o - 1
    _pressure(
        x[0], x[1], x[2],
        x[0, 1:], x[1, 1:], x[2, 1:],
        x[0, o + 1:], x[1, o + 1:], x[2, o + 1:],
        x[0, o:], x[1, o:], x[2, o:],
        u[0], u[1], u[2],
        u[0, 1:], u[1, 1:], u[2, 1:],
        u[0, o + 1:], u[1, o + 1:], u[2, o + 1:],
        u[0, o:], u[1, o:], u[2, o:],
        cloth.weight, c[0], c[1], c[2], c[3], c[4],
        w[0], w[1], w[2], w[3], w[4], w[5], n,
    )  # fmt: skip
    for d in range(3):
        _add_both(f[d], w[d], w[d + 3], n)
        _add(f[d, 1:], w[d], n)
        _add(f[d, o:], w[d + 3], n)
        _add_both(f[d, o + 1 :], w[d], w[d + 3], n)


class Cloth(NamedTuple):
    """The cloth in the air.

    Attributes
    ----------
    cols
        Offset of the particle above.
    weight : (particles - cols - 1,)
        rho / 12 over the number of layers, by the cell's first particle; zero where there is no cell [kg/m^3].
    constants : (5,)
        1/3, C_N + C_L - C_F, C_F, C_L and `TINY`.
    work : (copies, 6, particles)
        Forces of the two triangles of each cell [N].
    """

    cols: int
    weight: NDArray[Any]
    constants: NDArray[Any]
    work: NDArray[Any]


class BoundAirPressure(NamedTuple):
    """A cloth in a smooth wind [m/s]."""

    cloth: Cloth
    wind: Swing

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return ("wind",)

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Add the pressure of an air that is the same everywhere."""
        for d in range(3):
            _relative(v[d], f.dtype.type(swing_value(bound.wind, copy, d, lag)), scratch[d], x.shape[1])
        _press(bound.cloth, copy, x, scratch, f)

    @staticmethod
    @jit
    def advance(bound, copy, seconds):
        """Move the phase on."""
        swing_on(bound.wind, copy, seconds)


class BoundGustyAirPressure(NamedTuple):
    """A cloth in a turbulent wind [m/s]."""

    cloth: Cloth
    wind: Swing
    turbulence: Turbulence

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return "wind", "turbulence"

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Add the pressure of an air that differs from column to column."""
        cols, air = bound.cloth.cols, bound.cloth.work[copy, 0]
        for d in range(3):
            air_of_columns(bound.wind, bound.turbulence, copy, d, lag, air)
            for first in range(0, x.shape[1], cols):
                _relative_of_columns(v[d, first:], air, scratch[d, first:], cols)
        _press(bound.cloth, copy, x, scratch, f)

    @staticmethod
    @jit
    def advance(bound, copy, seconds):
        """Move the phase on and draw the next step's turbulence."""
        swing_on(bound.wind, copy, seconds)
        advance_turbulence(bound.turbulence, copy)


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
        Speed of the air relative to the cloth, in any direction, up to which the step limit covers the damping [m/s], >= 0. In a
        stream along the cloth, where the damping is half of that across it, twice this speed is covered. See `drag`.
    gusts
        Turbulence of the air; only its intensity, scale, speed and spectrum count. None: a smooth wind.
    """

    unit: ClassVar[str] = "m/s"

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
        for name in ("density", "normal", "lift", "friction", "max_speed"):
            object.__setattr__(self, name, validate.number(name, getattr(self, name), minimum=0.0))
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

    def cells(self, lattice: Lattice) -> NDArray[np.bool_]:
        """Whether a particle is the first of a cell, shape (particles - cols - 1,)."""
        _, row, col = np.indices(lattice.shape).reshape(3, -1)
        present = (row < lattice.rows - 1) & (col < lattice.cols - 1)
        return np.asarray(present[: lattice.size - lattice.cols - 1])

    def drag(self, lattice: Lattice) -> NDArray[np.float64]:
        """Bound of each particle's damping [N s/m], shape (particles,), while |u| A <= max_speed times the area at rest.

        Of the terms' slopes d/du, those of C_N and C_F together are at most 2 max(C_N, C_F) |u|, attained across the stream; the
        symmetric part of that of C_L is at most C_L |u|. A triangle's damping acts through the mean of its corners' velocities:
        a third of it on each corner bounds it. The change of the force as a triangle turns is no damping: the limit ignores it.
        """
        slope = 2.0 * max(self.normal, self.friction) + self.lift
        along, up, _ = lattice.steps
        corner = 0.5 * self.density / lattice.layers * (0.5 * along * up) * slope * self.max_speed / 3.0
        cells = corner * self.cells(lattice)
        result = np.zeros(lattice.size)
        for offset, triangles in ((0, 2), (1, 1), (lattice.cols, 1), (lattice.cols + 1, 2)):
            result[offset : offset + len(cells)] += triangles * cells
        return result

    def bind(self, setting: Setting) -> BoundAirPressure | BoundGustyAirPressure:
        """Air in float64, weights and constants in the scene's dtype."""
        lattice, dtype = setting.lattice, setting.dtype
        weight = (self.density / 12.0 / lattice.layers * self.cells(lattice)).astype(dtype)
        along = self.normal + self.lift - self.friction
        constants = np.array([1.0 / 3.0, along, self.friction, self.lift, TINY], dtype)
        work = np.zeros((setting.copies, 6, lattice.size), dtype)
        cloth, wind = Cloth(lattice.cols, weight, constants, work), self.swing(setting.copies)
        if self.gusts is None:
            return BoundAirPressure(cloth, wind)
        return BoundGustyAirPressure(cloth, wind, self.gusts.turbulence(setting))
