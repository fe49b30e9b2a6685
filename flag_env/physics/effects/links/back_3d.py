"""Derivatives of link forces in three coordinates, through the loops of the way forward; `back` tells the formulas."""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects._sums import total
from flag_env.physics.effects.links.chunks_3d import CHUNK, WIDE, clear, forces_3d, link, rest, sum_one
from flag_env.physics.effects.links.kernels import Dampers, Springs, add_family, near


class _Stretch3(Springs):
    """Derivatives of springs by the positions, from those by the forces in place of velocities."""

    @staticmethod
    def pull(data, dx, dy, dz, gx, gy, gz, weight, tension):
        """See `_pull`."""
        d2 = dx * dx + dy * dy + dz * dz + data.tiny
        pull = tension / np.sqrt(d2)
        s = weight * (data.stiffness - pull)
        q = weight * (pull * (dx * gx + dy * gy + dz * gz) / d2)
        return s * gx + q * dx, s * gy + q * dy, s * gz + q * dz


class _Brake3(Dampers):
    """Derivatives of isotropic dampers by the velocities, likewise."""

    @staticmethod
    def pull(data, dx, dy, dz, gx, gy, gz, weight, tension):
        """See `_pull`."""
        b = weight * data.viscosity
        return b * gx, b * gy, b * gz


@kernel
def _both(
    springs, dampers, x, y, z, u, v, w, weight, tension,
    ax, ay, az, bx, by, bz, offset, fx, fy, fz, ex, ey, ez, chunks,
):  # fmt: skip
    """Shares of one family's springs, and of its dampers, and their sums, in chunks: as `_two` of `chunks_3d`."""
    for chunk in range(chunks):
        start = np.uint64(chunk) * WIDE
        for t in range(CHUNK):
            i = start + np.uint64(t)
            own = i + offset
            ax[own], ay[own], az[own] = link(springs, x, y, z, u, v, w, i, own, weight, tension)
            bx[own], by[own], bz[own] = link(dampers, x, y, z, u, v, w, i, own, weight, tension)
        for t in range(CHUNK):
            i = start + np.uint64(t)
            own = i + offset
            fx[i] = fx[i] + ax[own] - ax[i]
            fy[i] = fy[i] + ay[own] - ay[i]
            fz[i] = fz[i] + az[own] - az[i]
            ex[i] = ex[i] + bx[own] - bx[i]
            ey[i] = ey[i] + by[own] - by[i]
            ez[i] = ez[i] + bz[own] - bz[i]


@jit
def elastic_back(data, copy, x, v, g, dx, dv, effect_work, lag):
    """Shares of springs."""
    springs = _Stretch3(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny)
    forces_3d(springs, copy, x, g, dx, effect_work, lag)


@jit
def isotropic_back(data, copy, x, v, g, dx, dv, effect_work, lag):
    """Shares of springs and isotropic dampers."""
    springs = _Stretch3(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny)
    dampers = _Brake3(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny, data.viscosity)
    weights, tension, s, n = data.weight[copy % data.weight.shape[0]], data.tension, effect_work, x.shape[1]
    for j in range(data.offset.shape[0]):
        o, start = data.offset[j], 0
        far = np.uint64(o)
        if near(o, n):
            chunks = (n - o) // CHUNK
            start = chunks * CHUNK
            for first in range(0, 6, 3):
                clear(s[first], s[first + 1], s[first + 2], np.uint64(0), o)
                clear(s[first], s[first + 1], s[first + 2], np.uint64(n), o)
            _both(
                springs, dampers, x[0], x[1], x[2], g[0], g[1], g[2], weights[j], tension[j], s[0], s[1], s[2], s[3], s[4], s[5],
                far, dx[0], dx[1], dx[2], dv[0], dv[1], dv[2], chunks,
            )  # fmt: skip
        zero = np.uint64(0)
        rest(
            springs, x[0], x[1], x[2], g[0], g[1], g[2], weights[j], tension[j], s[0], s[1], s[2], far, zero, start, n - o
        )  # fmt: skip
        rest(
            dampers, x[0], x[1], x[2], g[0], g[1], g[2], weights[j], tension[j], s[3], s[4], s[5], far, zero, start, n - o
        )  # fmt: skip
        if near(o, n):
            sum_one(dx[0], dx[1], dx[2], s[0], s[1], s[2], far, zero, start, n)
            sum_one(dv[0], dv[1], dv[2], s[3], s[4], s[5], far, zero, start, n)
        else:
            add_family(dx, s, o)
            add_family(dv, s[3:], o)


@kernel
def _slopes(
    x, y, z, u, v, w, a, b, c, far_x, far_y, far_z, far_u, far_v, far_w, far_a, far_b, far_c,
    weight, length, tiny, by_stiffness, by_viscosity, n,
):  # fmt: skip
    """Subtract G.dF/dp of one family's links, for derivatives (a, b, c) by the forces, by their first particles."""
    for t in range(n):
        dx, dy, dz = far_x[t] - x[t], far_y[t] - y[t], far_z[t] - z[t]
        da, db, dc = far_a[t] - a[t], far_b[t] - b[t], far_c[t] - c[t]
        along = dx * da + dy * db + dz * dc
        braked = (far_u[t] - u[t]) * da + (far_v[t] - v[t]) * db + (far_w[t] - w[t]) * dc
        stretch = 1 - length / np.sqrt(dx * dx + dy * dy + dz * dz + tiny)
        by_stiffness[t] -= weight[t] * (stretch * along)
        by_viscosity[t] -= weight[t] * braked


@kernel
def _clear_two(a, b, n):
    for t in range(n):
        a[t] = 0
        b[t] = 0


@jit
def isotropic_slopes_3d(data, copy, x, v, g, out, effect_work, lag):
    """By the stiffness and the viscosity: as `isotropic_slopes` of `back`, each family in one pass."""
    weight, size = data.weight[copy % data.weight.shape[0]], x.shape[1]
    _clear_two(effect_work[0], effect_work[1], size)
    for j in range(data.offset.shape[0]):
        o = data.offset[j]
        _slopes(
            x[0], x[1], x[2], v[0], v[1], v[2], g[0], g[1], g[2],
            x[0, o:], x[1, o:], x[2, o:], v[0, o:], v[1, o:], v[2, o:], g[0, o:], g[1, o:], g[2, o:],
            weight[j], data.length[j], data.tiny, effect_work[0], effect_work[1], size - o,
        )  # fmt: skip
    out[0] += total(effect_work[0], size)
    out[1] += total(effect_work[1], size)
