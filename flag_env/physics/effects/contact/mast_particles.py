"""Particles against the pole: who may touch it, and the push of who has entered it."""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel


@kernel
def count_near_pole(x, y, z, u, v, w, free, outside, foot, axis, speed, turn, ahead, inverse, low, radius, h, n):
    """Number of free particles that may have touched the pole, and of those that may have been less than r ahead of its axis.

    The first are those with |p|^2 < 2 r^2 + 2 |u t|^2, which holds wherever |p| < r + |u t|. Where there are none of the second,
    no cloth between particles has come near.
    """
    one = x.dtype.type(1)
    two = x.dtype.type(2)
    near = 0
    behind = 0
    for t in range(n):
        px = x[t] - foot[0]
        py = y[t] - foot[1]
        pz = z[t] - foot[2]
        s = min(max((px * axis[0] + py * axis[1] + pz * axis[2]) * inverse, low), one)
        px -= s * axis[0]
        py -= s * axis[1]
        pz -= s * axis[2]
        du = (u[t] - speed[0] - s * turn[0]) * h
        dv = (v[t] - speed[1] - s * turn[1]) * h
        dw = (w[t] - speed[2] - s * turn[2]) * h
        square = du * du + dv * dv + dw * dw
        spare = px * px + py * py + pz * pz - two * (radius * radius + square)
        near += (spare < 0) & (free[t] > 0)
        clear = px * ahead[0] + py * ahead[1] + pz * ahead[2] - radius
        behind += ((clear < 0) | (clear * clear < square)) & (outside[t] != 0)
    return near, behind


@jit
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def _plus(a, s, b):
    """Sum a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@jit
def _normal(p, d, axis, radius, tiny):
    """Whether a path from p - d to p touches the pole, and the unit normal there; p and d are relative to the pole."""
    zero = radius * 0
    one = zero + type(radius)(1)
    q = _plus(p, -one, d)
    inside, before = dot(p, p) < radius * radius, dot(q, q) < radius * radius
    if not before:
        a, b, c = dot(d, d), dot(q, d), dot(q, q) - radius * radius
        root = b * b - a * c
        if b < 0 and root > 0 and (inside or -b - np.sqrt(root) <= a):
            entry = _plus(q, (-b - np.sqrt(root)) / a, d)
            return True, _plus((zero, zero, zero), one / np.sqrt(dot(entry, entry)), entry)
    if not inside:
        return False, p
    away = p
    if dot(away, away) <= tiny:
        away = q
    if dot(away, away) <= tiny:  # on the axis, at rest: any direction across it
        away = (-axis[1], axis[0], zero) if abs(axis[2]) < abs(axis[0]) + abs(axis[1]) else (axis[2], zero, -axis[0])
    if dot(away, away) <= tiny:
        away = (one, zero, zero)
    return True, _plus((zero, zero, zero), one / np.sqrt(dot(away, away)), away)


@jit
def keep_particles_out(x, v, inverse_mass, foot, axis, speed, turn, inverse, low, radius, bounce, friction, tiny, h):
    """Move the particles that have entered the pole to its surface, stop their approach and brake their sliding."""
    one = radius * 0 + type(radius)(1)
    for t in range(x.shape[1]):
        if inverse_mass[t] == 0:
            continue
        p = _plus((x[0, t], x[1, t], x[2, t]), -one, foot)
        along = dot(p, axis) * inverse
        s = min(max(along, low), one)
        p = _plus(p, -s, axis)
        pole = _plus(speed, s, turn)
        u = _plus((v[0, t], v[1, t], v[2, t]), -one, pole)
        across = u
        if low < along < one:  # beside the pole, not at its ends: sliding along it is no approach
            across = _plus(u, -dot(u, axis) * inverse, axis)
        touched, n = _normal(p, _plus((h * 0, h * 0, h * 0), h, across), axis, radius, tiny)
        if not touched:
            continue
        depth = radius - dot(p, n)
        if depth > 0:
            for d in range(3):
                x[d, t] += depth * n[d]
        rate = dot(u, n)
        if rate < 0:
            slide = _plus(u, -rate, n)
            size = np.sqrt(dot(slide, slide))
            kept = one - min(-friction * bounce * rate / size, one) if size > 0 else one
            u = _plus((pole[0], pole[1], pole[2]), kept, slide)
            u = _plus(u, rate - bounce * rate, n)
            for d in range(3):
                v[d, t] = u[d]


@jit
def push_particles_out(x, inverse_mass, foot, axis, inverse, low, radius):
    """Put the particles that are in the pole on its surface."""
    one = radius * 0 + type(radius)(1)
    for t in range(x.shape[1]):
        if inverse_mass[t] == 0:
            continue
        p = _plus((x[0, t], x[1, t], x[2, t]), -one, foot)
        p = _plus(p, -min(max(dot(p, axis) * inverse, low), one), axis)
        square = dot(p, p)
        if 0 < square < radius * radius:
            depth = radius / np.sqrt(square) - one
            for d in range(3):
                x[d, t] += depth * p[d]
