"""Compiled link forces in one coordinate: a rope whose particles move along z only, linear in their displacements.

F = w [k (z2 - z1) + z (w2 - w1)]: no length and no root. Both kinds of damping are the same here.
"""

from __future__ import annotations

from flag_env.physics.compiling import inlined, jit, kernel
from flag_env.physics.effects.links.kernels import Dampers, Springs, gather, pad


def _pull(data, dz, dw, weight):
    """Force of a link of this weight on its first particle, from the differences of its ends' positions and velocities."""
    return data.pull(data, dz, dw, weight)


@inlined(_pull)
def _compile_pull(data, dz, dw, weight):
    return data.instance_class.pull


@kernel
def _family(data, z, w, far_z, far_w, weight, fz, n):
    for t in range(n):
        fz[t] = _pull(data, far_z[t] - z[t], far_w[t] - w[t], weight[t])


@jit
def _forces(data, copy, x, v, f, effect_work, lag):
    """Forces of every family."""
    weight = data.weight[copy % data.weight.shape[0]]
    for j in range(data.offset.shape[0]):
        o = data.offset[j]
        g = effect_work[3 * (j % 2) :]
        pad(g, 1, o, x.shape[1])
        _family(data, x[0], v[0], x[0, o:], v[0, o:], weight[j], g[0, o:], x.shape[1] - o)
        gather(f, effect_work, data.offset, j)


class Elastic1(Springs):
    """Springs alone."""

    force = staticmethod(_forces)

    @staticmethod
    def pull(data, dz, dw, weight):
        """See `_pull`."""
        return weight * data.stiffness * dz


class Damped1(Dampers):
    """Springs with dampers."""

    force = staticmethod(_forces)

    @staticmethod
    def pull(data, dz, dw, weight):
        """See `_pull`."""
        return weight * (data.stiffness * dz + data.viscosity * dw)
