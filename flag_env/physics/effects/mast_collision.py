"""Mast collision: the cloth does not enter the pole that it hangs on.

The pole is a capsule: all points nearer than r to a segment. The segment runs from the first to the last pinned row of column 0,
layer 0, wherever these are now, and on below the first by a length h. After each step, for a particle at p from the nearest point
of the segment, moving at u relative to the pole there, n the unit normal where its path entered the pole, or p/|p| if it was
inside before:

    position:               p += (r - p.n) n   where p.n < r
    velocity, if u.n < 0:   u -= (1 + e) (u.n) n, and at most mu (1 + e) |u.n| off the sliding u - (u.n) n

The path p - u t, 0 <= t <= one step, is tested, so that no speed carries a particle across. Only particles are tested: cloth
between them may cut into the pole by less than r. The pole moves as told and feels nothing. Pinned particles lie on the axis and
are left alone; free ones must stand outside at rest, so that r is less than the spacing. Forces and the step limit stay as they
are. Effects that move particles after the step (self-collision) belong before this one.

Parameters: radius r [m], below h [m], friction mu [1], restitution e [1]. Source: Bridson, Fedkiw, Anderson, Robust Treatment of
Collisions, Contact and Friction for Cloth Animation, SIGGRAPH 2002, section 4 (friction of a moving body).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flag_env.physics import validate
from flag_env.physics.effects.base import Effect, Setting
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Lattice

TINY = 1e-30
"""Squared length [m^2] below which a vector has no direction."""


@kernel
def _count_near(x, y, z, u, v, w, inverse_mass, foot, axis, speed, turn, inverse, low, radius, h, n):
    """Number of free particles that may have touched the pole: |p|^2 < 2 r^2 + 2 |u t|^2 holds wherever |p| < r + |u t|."""
    one = x.dtype.type(1)
    two = x.dtype.type(2)
    near = 0
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
        spare = px * px + py * py + pz * pz - two * (radius * radius + du * du + dv * dv + dw * dw)
        near += (spare < 0) & (inverse_mass[t] > 0)
    return near


@jit
def _dot(a, b):
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
    inside, before = _dot(p, p) < radius * radius, _dot(q, q) < radius * radius
    if not before:
        a, b, c = _dot(d, d), _dot(q, d), _dot(q, q) - radius * radius
        root = b * b - a * c
        if b < 0 and root > 0 and (inside or -b - np.sqrt(root) <= a):
            entry = _plus(q, (-b - np.sqrt(root)) / a, d)
            return True, _plus((zero, zero, zero), one / np.sqrt(_dot(entry, entry)), entry)
    if not inside:
        return False, p
    away = p
    if _dot(away, away) <= tiny:
        away = q
    if _dot(away, away) <= tiny:  # on the axis, at rest: any direction across it
        away = (-axis[1], axis[0], zero) if abs(axis[2]) < abs(axis[0]) + abs(axis[1]) else (axis[2], zero, -axis[0])
    if _dot(away, away) <= tiny:
        away = (one, zero, zero)
    return True, _plus((zero, zero, zero), one / np.sqrt(_dot(away, away)), away)


@jit
def _keep_out(x, v, inverse_mass, foot, axis, speed, turn, inverse, low, radius, bounce, friction, tiny, h):
    """Move the particles that have entered the pole to its surface, stop their approach and brake their sliding."""
    one = radius * 0 + type(radius)(1)
    for t in range(x.shape[1]):
        if inverse_mass[t] == 0:
            continue
        p = _plus((x[0, t], x[1, t], x[2, t]), -one, foot)
        along = _dot(p, axis) * inverse
        s = min(max(along, low), one)
        p = _plus(p, -s, axis)
        pole = _plus(speed, s, turn)
        u = _plus((v[0, t], v[1, t], v[2, t]), -one, pole)
        across = u
        if low < along < one:  # beside the pole, not at its ends: sliding along it is no approach
            across = _plus(u, -_dot(u, axis) * inverse, axis)
        touched, n = _normal(p, _plus((h * 0, h * 0, h * 0), h, across), axis, radius, tiny)
        if not touched:
            continue
        depth = radius - _dot(p, n)
        if depth > 0:
            for d in range(3):
                x[d, t] += depth * n[d]
        rate = _dot(u, n)
        if rate < 0:
            slide = _plus(u, -rate, n)
            size = np.sqrt(_dot(slide, slide))
            kept = one - min(-friction * bounce * rate / size, one) if size > 0 else one
            u = _plus((pole[0], pole[1], pole[2]), kept, slide)
            u = _plus(u, rate - bounce * rate, n)
            for d in range(3):
                v[d, t] = u[d]


class BoundMastCollision(NamedTuple):
    """Particles at the axis' ends; radius and length below the foot [m]; 1 + restitution; friction; least square [m^2]."""

    foot: int
    top: int
    radius: Any
    below: Any
    bounce: Any
    friction: Any
    tiny: Any

    @staticmethod
    @jit
    def project(bound, copy, x, v, scratch, inverse_mass, seconds):
        """Find the pole; look closer only if a particle may touch it."""
        h = x.dtype.type(seconds)
        a, b = bound.foot, bound.top
        foot = x[0, a], x[1, a], x[2, a]
        axis = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
        speed = v[0, a], v[1, a], v[2, a]
        turn = v[0, b] - v[0, a], v[1, b] - v[1, a], v[2, b] - v[2, a]
        inverse = x.dtype.type(1) / (_dot(axis, axis) + bound.tiny)
        low = -bound.below * np.sqrt(inverse)
        near = _count_near(
            x[0], x[1], x[2], v[0], v[1], v[2], inverse_mass, foot, axis, speed, turn, inverse, low, bound.radius, h, x.shape[1]
        )
        if near:
            _keep_out(
                x, v, inverse_mass, foot, axis, speed, turn, inverse, low,
                bound.radius, bound.bounce, bound.friction, bound.tiny, h,
            )  # fmt: skip


@dataclass(frozen=True)
class MastCollision(Effect):
    """A pole that the cloth cannot enter.

    Parameters
    ----------
    radius
        Of the pole [m], >= 0; at 0 nothing can meet it.
    below
        How far the pole goes on below the lowest pinned particle [m], >= 0.
    friction
        Coefficient of friction, >= 0.
    restitution
        Share of the approach velocity with which a particle leaves, 0 to 1.
    """

    rank: ClassVar[int] = 2

    radius: float = 0.02
    below: float = 1.0
    friction: float = 0.3
    restitution: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", validate.number("radius", self.radius, minimum=0.0))
        for name in ("below", "friction", "restitution"):
            object.__setattr__(self, name, validate.number(name, getattr(self, name), minimum=0.0))
        if self.restitution > 1:
            raise ValueError(f"restitution must be at most 1, got {self.restitution!r}")

    @property
    def smooth(self) -> bool:
        """Contact begins and ends."""
        return False

    def check(self, lattice: Lattice) -> None:
        """There must be a mast, and at rest the free particles must stand outside it."""
        if lattice.dimensions != 3:
            raise ValueError(f"MastCollision must act in 3 dimensions, got a lattice with dimensions={lattice.dimensions}")
        foot, top = self.ends(lattice)
        rest = lattice.rest_positions.reshape(-1, 3)
        axis = rest[top] - rest[foot]
        length = float(np.linalg.norm(axis))
        from_foot = rest - rest[foot]
        share = np.clip(from_foot @ axis / length**2, -self.below / length, 1.0)
        nearest = np.linalg.norm(from_foot - share[:, None] * axis, axis=1)[~lattice.fixed].min(initial=np.inf)
        if nearest <= self.radius:
            raise ValueError(f"radius must leave the free particles outside at rest, below {nearest:g} m, got {self.radius:g}")

    @staticmethod
    def ends(lattice: Lattice) -> tuple[int, int]:
        """Lowest and highest pinned particle of column 0, layer 0."""
        pinned = np.flatnonzero(lattice.fixed.reshape(lattice.shape)[0, :, 0]) * lattice.cols
        if len(pinned) < 2:
            raise ValueError(f"MastCollision must have two pinned particles in column 0 to lie along, got {len(pinned)}")
        return int(pinned[0]), int(pinned[-1])

    def bind(self, setting: Setting) -> BoundMastCollision:
        """Constants in the scene's dtype."""
        number = setting.dtype.type
        values = (self.radius, self.below, 1 + self.restitution, self.friction, TINY)
        return BoundMastCollision(*self.ends(setting.lattice), *(number(value) for value in values))
