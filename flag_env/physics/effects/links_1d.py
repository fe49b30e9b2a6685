"""Compiled link forces in one coordinate: a rope whose particles move along z only, linear in their displacements.

F = w [k (z2 - z1) + z (w2 - w1)]: no length and no root. Both kinds of damping are the same here.
"""

from __future__ import annotations

from flag_env.physics.effects.links import Dampers, Springs, gather, pad
from flag_env.physics.jit import jit, kernel


@kernel
def _elastic(z, zb, weight, k, fz, n):
    for t in range(n):
        fz[t] = weight[t] * k * (zb[t] - z[t])


@kernel
def _damped(z, w, zb, wb, weight, k, c, fz, n):
    for t in range(n):
        fz[t] = weight[t] * (k * (zb[t] - z[t]) + c * (wb[t] - w[t]))


class Elastic1(Springs):
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
            pad(g, 1, o, x.shape[1])
            _elastic(
                x[0],
                x[0, o:],
                weight[j], bound.stiffness,
                g[0, o:], n,
            )  # fmt: skip
            gather(f, scratch, bound.offset, j)


class Damped1(Dampers):
    """Springs with dampers."""

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Forces of every family."""
        weight = bound.weight[copy % bound.weight.shape[0]]
        for j in range(bound.offset.shape[0]):
            o = bound.offset[j]
            n = x.shape[1] - o
            g = scratch[3 * (j % 2) :]
            pad(g, 1, o, x.shape[1])
            _damped(
                x[0], v[0],
                x[0, o:], v[0, o:],
                weight[j], bound.stiffness, bound.viscosity,
                g[0, o:], n,
            )  # fmt: skip
            gather(f, scratch, bound.offset, j)
