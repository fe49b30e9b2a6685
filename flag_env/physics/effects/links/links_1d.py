"""Compiled link forces in one coordinate: a rope whose particles move along z only, linear in their displacements.

F = w [k (z2 - z1) + z (w2 - w1)]: no length and no root. Both kinds of damping are the same here.
"""

from __future__ import annotations

from flag_env.physics.compiling import inlined, jit, kernel
from flag_env.physics.effects.links.back import by_both, by_stiffness, elastic_slopes, isotropic_slopes
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


class _Stretch1(Springs):
    """Derivatives of springs by the positions, from those by the forces in place of velocities."""

    @staticmethod
    def pull(data, dz, gz, weight):
        """See `_pull`."""
        return weight * data.stiffness * gz


class _Brake1(Dampers):
    """Derivatives of isotropic dampers by the velocities, likewise."""

    @staticmethod
    def pull(data, dz, gz, weight):
        """See `_pull`."""
        return weight * data.viscosity * gz


@jit
def _elastic_back(data, copy, x, v, g, dx, dv, effect_work, lag):
    """Shares of springs."""
    springs = _Stretch1(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny)
    _forces(springs, copy, x, g, dx, effect_work, lag)


@jit
def _isotropic_back(data, copy, x, v, g, dx, dv, effect_work, lag):
    """Shares of springs and isotropic dampers."""
    springs = _Stretch1(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny)
    _forces(springs, copy, x, g, dx, effect_work, lag)
    dampers = _Brake1(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny, data.viscosity)
    _forces(dampers, copy, x, g, dv, effect_work, lag)


class Elastic1(Springs):
    """Springs alone."""

    force = staticmethod(_forces)
    pull_back = staticmethod(_elastic_back)
    slopes = staticmethod(elastic_slopes)
    parameters = staticmethod(by_stiffness)

    @staticmethod
    def pull(data, dz, dw, weight):
        """See `_pull`."""
        return weight * data.stiffness * dz


class Damped1(Dampers):
    """Springs with dampers."""

    force = staticmethod(_forces)
    pull_back = staticmethod(_isotropic_back)
    slopes = staticmethod(isotropic_slopes)
    parameters = staticmethod(by_both)

    @staticmethod
    def pull(data, dz, dw, weight):
        """See `_pull`."""
        return weight * (data.stiffness * dz + data.viscosity * dw)
