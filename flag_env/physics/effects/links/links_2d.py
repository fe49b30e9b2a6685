"""Compiled link forces in two coordinates, x and z: a cloth in its plane; the formulas stand in `link_effect`."""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import inlined, jit, kernel
from flag_env.physics.effects.links.back import axial_back, axial_slopes, by_both, by_stiffness, elastic_slopes, isotropic_slopes
from flag_env.physics.effects.links.kernels import Dampers, Springs, gather, pad


def _pull(data, dx, dz, du, dw, weight, tension):
    """Force of a link of this weight on its first particle, from the differences of its ends' positions and velocities."""
    return data.pull(data, dx, dz, du, dw, weight, tension)


@inlined(_pull)
def _compile_pull(data, dx, dz, du, dw, weight, tension):
    return data.instance_class.pull


@kernel
def _family(data, x, z, u, w, far_x, far_z, far_u, far_w, weight, tension, fx, fz, n):
    for t in range(n):
        fx[t], fz[t] = _pull(data, far_x[t] - x[t], far_z[t] - z[t], far_u[t] - u[t], far_w[t] - w[t], weight[t], tension)


@jit
def _forces(data, copy, x, v, f, effect_work, lag):
    """Forces of every family."""
    weight = data.weight[copy % data.weight.shape[0]]
    for j in range(data.offset.shape[0]):
        o = data.offset[j]
        g = effect_work[3 * (j % 2) :]
        pad(g, 2, o, x.shape[1])
        _family(
            data, x[0], x[1], v[0], v[1], x[0, o:], x[1, o:], v[0, o:], v[1, o:],
            weight[j], data.tension[j], g[0, o:], g[1, o:], x.shape[1] - o,
        )  # fmt: skip
        gather(f, effect_work, data.offset, j)


class _Stretch2(Springs):
    """Derivatives of springs by the positions, from those by the forces in place of velocities."""

    @staticmethod
    def pull(data, dx, dz, gx, gz, weight, tension):
        """See `_pull`."""
        d2 = dx * dx + dz * dz + data.tiny
        pull = tension / np.sqrt(d2)
        s = weight * (data.stiffness - pull)
        q = weight * (pull * (dx * gx + dz * gz) / d2)
        return s * gx + q * dx, s * gz + q * dz


class _Brake2(Dampers):
    """Derivatives of isotropic dampers by the velocities, likewise."""

    @staticmethod
    def pull(data, dx, dz, gx, gz, weight, tension):
        """See `_pull`."""
        b = weight * data.viscosity
        return b * gx, b * gz


@jit
def _elastic_back(data, copy, x, v, g, dx, dv, effect_work, lag):
    """Shares of springs."""
    springs = _Stretch2(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny)
    _forces(springs, copy, x, g, dx, effect_work, lag)


@jit
def _isotropic_back(data, copy, x, v, g, dx, dv, effect_work, lag):
    """Shares of springs and isotropic dampers."""
    springs = _Stretch2(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny)
    _forces(springs, copy, x, g, dx, effect_work, lag)
    dampers = _Brake2(data.offset, data.weight, data.stiffness, data.tension, data.length, data.tiny, data.viscosity)
    _forces(dampers, copy, x, g, dv, effect_work, lag)


class Elastic2(Springs):
    """Springs alone."""

    force = staticmethod(_forces)
    pull_back = staticmethod(_elastic_back)
    slopes = staticmethod(elastic_slopes)
    parameters = staticmethod(by_stiffness)

    @staticmethod
    def pull(data, dx, dz, du, dw, weight, tension):
        """See `_pull`."""
        s = weight * (data.stiffness - tension / np.sqrt(dx * dx + dz * dz + data.tiny))
        return s * dx, s * dz


class Isotropic2(Dampers):
    """Springs with isotropic dampers."""

    force = staticmethod(_forces)
    pull_back = staticmethod(_isotropic_back)
    slopes = staticmethod(isotropic_slopes)
    parameters = staticmethod(by_both)

    @staticmethod
    def pull(data, dx, dz, du, dw, weight, tension):
        """See `_pull`."""
        s = weight * (data.stiffness - tension / np.sqrt(dx * dx + dz * dz + data.tiny))
        b = weight * data.viscosity
        return s * dx + b * du, s * dz + b * dw


class Axial2(Dampers):
    """Springs with axial dampers."""

    force = staticmethod(_forces)
    pull_back = staticmethod(axial_back)
    slopes = staticmethod(axial_slopes)
    parameters = staticmethod(by_both)

    @staticmethod
    def pull(data, dx, dz, du, dw, weight, tension):
        """See `_pull`."""
        d2 = dx * dx + dz * dz + data.tiny
        rate = dx * du + dz * dw
        s = weight * (data.stiffness - tension / np.sqrt(d2) + data.viscosity * rate / d2)
        return s * dx, s * dz
