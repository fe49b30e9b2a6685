"""Derivatives of link forces, compiled, in any number of coordinates; the formulas of the forces stand in `link_effect`.

With D = x2 - x1, V = v2 - v1, G = g2 - g1 for derivatives g with respect to the forces, the pair of forces being F(D, V) and -F:
the first end's share is J' G of either Jacobian of F, the second end's its opposite,

    springs:           J' G = w [k (1 - l/d) G + k (l/d^3) (D.G) D]
    isotropic dampers: J' G = w z G, by the velocities
    axial dampers:     J' G = w z (D.G) D / d^2, by the velocities
                       J' G = w z [(D.V) G + (D.G) V - 2 (D.V) (D.G) D / d^2] / d^2, by the positions

which has the form of a link's force, so that springs and isotropic dampers go through the kernels of the way forward. A
parameter's slope is the sum of -G.dF/dp over the links; sums are kept by particle, in rows, and taken together at the end.
"""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects._sums import total
from flag_env.physics.effects.links.kernels import _add, _clear, _subtract


@kernel
def _square(x, far_x, d2, n):
    for t in range(n):
        dx = far_x[t] - x[t]
        d2[t] += dx * dx


@kernel
def _product(x, far_x, y, far_y, out, n):
    for t in range(n):
        out[t] += (far_x[t] - x[t]) * (far_y[t] - y[t])


@kernel
def _axial_factors(d2, xg, xv, weight, stiffness, tension, viscosity, tiny, n):
    """Factors of G, D and V in place of d^2, D.G and D.V."""
    for t in range(n):
        square = d2[t] + tiny
        pull = tension / np.sqrt(square)
        braked = viscosity * xg[t] / square
        turned = viscosity * xv[t] / square
        d2[t] = weight[t] * (stiffness - pull + turned)
        xg[t], xv[t] = weight[t] * ((pull * xg[t]) / square - 2 * turned * (xg[t] / square)), weight[t] * braked


@kernel
def _axial_share(x, far_x, v, far_v, g, far_g, by_g, by_x, by_v, out, n):
    for t in range(n):
        out[t] = by_g[t] * (far_g[t] - g[t]) + by_x[t] * (far_x[t] - x[t]) + by_v[t] * (far_v[t] - v[t])


@kernel
def _axial_brake(x, far_x, by_v, out, n):
    for t in range(n):
        out[t] = by_v[t] * (far_x[t] - x[t])


@jit
def axial_back(data, copy, x, v, g, dx, dv, effect_work, lag):
    """Add the shares of springs and axial dampers."""
    weight = data.weight[copy % data.weight.shape[0]]
    for j in range(data.offset.shape[0]):
        o = data.offset[j]
        n = x.shape[1] - o
        for row in range(3):
            _clear(effect_work[row], n)
        for d in range(x.shape[0]):
            _square(x[d], x[d, o:], effect_work[0], n)
            _product(x[d], x[d, o:], g[d], g[d, o:], effect_work[1], n)
            _product(x[d], x[d, o:], v[d], v[d, o:], effect_work[2], n)
        _axial_factors(
            effect_work[0],
            effect_work[1],
            effect_work[2],
            weight[j],
            data.stiffness,
            data.tension[j],
            data.viscosity,
            data.tiny,
            n,
        )
        for d in range(x.shape[0]):
            _axial_share(
                x[d], x[d, o:], v[d], v[d, o:], g[d], g[d, o:],
                effect_work[0], effect_work[1], effect_work[2], effect_work[3], n,
            )  # fmt: skip
            _add(dx[d], effect_work[3], n)
            _subtract(dx[d, o:], effect_work[3], n)
            _axial_brake(x[d], x[d, o:], effect_work[2], effect_work[3], n)
            _add(dv[d], effect_work[3], n)
            _subtract(dv[d, o:], effect_work[3], n)


@kernel
def _by_stiffness(d2, xg, weight, length, tiny, out, n):
    for t in range(n):
        out[t] -= weight[t] * (1 - length / np.sqrt(d2[t] + tiny)) * xg[t]


@kernel
def _by_isotropic_viscosity(vg, weight, out, n):
    for t in range(n):
        out[t] -= weight[t] * vg[t]


@kernel
def _by_axial_viscosity(d2, xg, xv, weight, tiny, out, n):
    for t in range(n):
        out[t] -= weight[t] * (xv[t] / (d2[t] + tiny)) * xg[t]


@jit
def _by_springs(data, j, weight, x, g, effect_work, n):
    """Add the slopes of a family by the stiffness to row 0; leave d^2 in row 2 and D.G in row 3."""
    o = data.offset[j]
    _clear(effect_work[2], n)
    _clear(effect_work[3], n)
    for d in range(x.shape[0]):
        _square(x[d], x[d, o:], effect_work[2], n)
        _product(x[d], x[d, o:], g[d], g[d, o:], effect_work[3], n)
    _by_stiffness(effect_work[2], effect_work[3], weight, data.length[j], data.tiny, effect_work[0], n)


@jit
def elastic_slopes(data, copy, x, v, g, out, effect_work, lag):
    """By the stiffness."""
    weight = data.weight[copy % data.weight.shape[0]]
    _clear(effect_work[0], x.shape[1])
    for j in range(data.offset.shape[0]):
        _by_springs(data, j, weight[j], x, g, effect_work, x.shape[1] - data.offset[j])
    out[0] += total(effect_work[0], x.shape[1])


@jit
def isotropic_slopes(data, copy, x, v, g, out, effect_work, lag):
    """By the stiffness and the viscosity."""
    weight = data.weight[copy % data.weight.shape[0]]
    _clear(effect_work[0], x.shape[1])
    _clear(effect_work[1], x.shape[1])
    for j in range(data.offset.shape[0]):
        o = data.offset[j]
        n = x.shape[1] - o
        _by_springs(data, j, weight[j], x, g, effect_work, n)
        _clear(effect_work[4], n)
        for d in range(x.shape[0]):
            _product(v[d], v[d, o:], g[d], g[d, o:], effect_work[4], n)
        _by_isotropic_viscosity(effect_work[4], weight[j], effect_work[1], n)
    out[0] += total(effect_work[0], x.shape[1])
    out[1] += total(effect_work[1], x.shape[1])


@jit
def axial_slopes(data, copy, x, v, g, out, effect_work, lag):
    """By the stiffness and the viscosity."""
    weight = data.weight[copy % data.weight.shape[0]]
    _clear(effect_work[0], x.shape[1])
    _clear(effect_work[1], x.shape[1])
    for j in range(data.offset.shape[0]):
        o = data.offset[j]
        n = x.shape[1] - o
        _by_springs(data, j, weight[j], x, g, effect_work, n)
        _clear(effect_work[4], n)
        for d in range(x.shape[0]):
            _product(x[d], x[d, o:], v[d], v[d, o:], effect_work[4], n)
        _by_axial_viscosity(effect_work[2], effect_work[3], effect_work[4], weight[j], data.tiny, effect_work[1], n)
    out[0] += total(effect_work[0], x.shape[1])
    out[1] += total(effect_work[1], x.shape[1])


def by_stiffness() -> tuple[str, ...]:
    """What the slopes of springs are with respect to."""
    return ("stiffness",)


def by_both() -> tuple[str, ...]:
    """What the slopes of springs with dampers are with respect to."""
    return "stiffness", "viscosity"
