"""Compiled link forces in two coordinates, x and z: a cloth in its plane; the formulas stand in `springs`."""

from __future__ import annotations

import numpy as np

from flag_env.physics.effects.links import Dampers, Springs, gather, pad
from flag_env.physics.jit import jit, kernel


@kernel
def _elastic(x, z, xb, zb, weight, k, kl, tiny, fx, fz, n):
    for t in range(n):
        dx = xb[t] - x[t]
        dz = zb[t] - z[t]
        a = weight[t] * (k - kl / np.sqrt(dx * dx + dz * dz + tiny))
        fx[t] = a * dx
        fz[t] = a * dz


@kernel
def _isotropic(x, z, u, w, xb, zb, ub, wb, weight, k, kl, c, tiny, fx, fz, n):
    for t in range(n):
        dx = xb[t] - x[t]
        dz = zb[t] - z[t]
        a = weight[t] * (k - kl / np.sqrt(dx * dx + dz * dz + tiny))
        b = weight[t] * c
        fx[t] = a * dx + b * (ub[t] - u[t])
        fz[t] = a * dz + b * (wb[t] - w[t])


@kernel
def _axial(x, z, u, w, xb, zb, ub, wb, weight, k, kl, c, tiny, fx, fz, n):
    for t in range(n):
        dx = xb[t] - x[t]
        dz = zb[t] - z[t]
        d2 = dx * dx + dz * dz + tiny
        rate = dx * (ub[t] - u[t]) + dz * (wb[t] - w[t])
        a = weight[t] * (k - kl / np.sqrt(d2) + c * rate / d2)
        fx[t] = a * dx
        fz[t] = a * dz


class Elastic2(Springs):
    """Springs alone."""

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Forces of every family."""
        weight = bound.weight[copy % bound.weight.shape[0]]
        for j in range(bound.offset.shape[0]):
            o = bound.offset[j]
            n = x.shape[1] - o
            g = scratch[3 * (j % 2) :]
            pad(g, 2, o, x.shape[1])
            _elastic(
                x[0], x[1],
                x[0, o:], x[1, o:],
                weight[j], bound.stiffness, bound.tension[j], bound.tiny,
                g[0, o:], g[1, o:], n,
            )  # fmt: skip
            gather(f, scratch, bound.offset, j)


class Isotropic2(Dampers):
    """Springs with isotropic dampers."""

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Forces of every family."""
        weight = bound.weight[copy % bound.weight.shape[0]]
        for j in range(bound.offset.shape[0]):
            o = bound.offset[j]
            n = x.shape[1] - o
            g = scratch[3 * (j % 2) :]
            pad(g, 2, o, x.shape[1])
            _isotropic(
                x[0], x[1], v[0], v[1],
                x[0, o:], x[1, o:], v[0, o:], v[1, o:],
                weight[j], bound.stiffness, bound.tension[j], bound.viscosity, bound.tiny,
                g[0, o:], g[1, o:], n,
            )  # fmt: skip
            gather(f, scratch, bound.offset, j)


class Axial2(Dampers):
    """Springs with axial dampers."""

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Forces of every family."""
        weight = bound.weight[copy % bound.weight.shape[0]]
        for j in range(bound.offset.shape[0]):
            o = bound.offset[j]
            n = x.shape[1] - o
            g = scratch[3 * (j % 2) :]
            pad(g, 2, o, x.shape[1])
            _axial(
                x[0], x[1], v[0], v[1],
                x[0, o:], x[1, o:], v[0, o:], v[1, o:],
                weight[j], bound.stiffness, bound.tension[j], bound.viscosity, bound.tiny,
                g[0, o:], g[1, o:], n,
            )  # fmt: skip
            gather(f, scratch, bound.offset, j)
