"""The forces of the air on a cloth's triangles, compiled; `AirPressure` tells the formulas."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.compiling import inlined, jit, kernel

TINY = 1e-30
"""Added to |u|^2 |2 A n|^2 [m^6/s^2]: keeps a triangle without area or wind finite."""


@kernel
def _pressure(
    xa, ya, za, xb, yb, zb, xc, yc, zc, xd, yd, zd, ua, va, wa, ub, vb, wb, uc, vc, wc, ud, vd, wd,
    weight, third, along, friction, lift, tiny, beyond, fx, fy, fz, gx, gy, gz, n,
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
        r = np.sqrt(nn * uu + tiny)  # 2 A |u|
        q = weight[t] / max(r, beyond * r * r)
        p = q * along * uu * un
        s = q * (friction * nn * uu - lift * un * un)
        fx[t], fy[t], fz[t] = p * nx + s * ux, p * ny + s * uy, p * nz + s * uz

        bx, by, bz = xd[t] - xa[t], yd[t] - ya[t], zd[t] - za[t]
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        ux, uy, uz = third * (sx + ud[t]), third * (sy + vd[t]), third * (sz + wd[t])
        nn = nx * nx + ny * ny + nz * nz
        uu = ux * ux + uy * uy + uz * uz
        un = ux * nx + uy * ny + uz * nz
        r = np.sqrt(nn * uu + tiny)  # 2 A |u|
        q = weight[t] / max(r, beyond * r * r)
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
def press(cloth, copy, x, u, f):
    """Add the forces of all cells, given the air's velocity relative to every particle."""
    _prepare(cloth, copy)
    o, w, c = cloth.cols, cloth.work[copy], cloth.constants
    weight = cloth.weight[copy % cloth.weight.shape[0]]
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
        weight, c[0], c[1], c[2], c[3], c[4], c[5],
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
    weight : (1, particles - cols - 1)
        rho / 12 over the number of layers, by the cell's first particle; zero where there is no cell [kg/m^3].
    constants : (6,)
        1/3, C_N + C_L - C_F, C_F, C_L, `TINY`, and 1 over `max_speed` times twice a triangle's area at rest [s/m^3].
    work : (copies, 6, particles)
        Forces of the two triangles of each cell [N].
    """

    cols: int
    weight: NDArray[Any]
    constants: NDArray[Any]
    work: NDArray[Any]

    @staticmethod
    def prepare(cloth, copy):
        """Nothing changes."""


class TearingCloth(NamedTuple):
    """A cloth in the air that may tear.

    Attributes
    ----------
    cols, constants, work
        As for `Cloth`.
    weight : (copies, particles - cols - 1)
        As for `Cloth`, zero where a cell is torn.
    whole : (particles - cols - 1,)
        The weights of the cloth that is not torn.
    sides : (copies, 2, particles)
        Weights of the links along rows and up columns, zero where broken.
    """

    cols: int
    weight: NDArray[Any]
    constants: NDArray[Any]
    work: NDArray[Any]
    whole: NDArray[Any]
    sides: NDArray[Any]

    @staticmethod
    def prepare(cloth, copy):
        """Give the cells whose four sides hold their weight, the others none."""
        along, up = cloth.sides[copy, 0], cloth.sides[copy, 1]
        _hold(cloth.weight[copy], cloth.whole, along, along[cloth.cols :], up, up[1:], cloth.whole.shape[0])


@kernel
def _hold(weight, whole, bottom, top, left, right, n):
    for t in range(n):
        holds = (bottom[t] != 0) & (top[t] != 0) & (left[t] != 0) & (right[t] != 0)
        weight[t] = whole[t] if holds else 0


def _prepare(cloth, copy):
    cloth.prepare(cloth, copy)


@inlined(_prepare)
def _compile_prepare(cloth, copy):
    return cloth.instance_class.prepare
