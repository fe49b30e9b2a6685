"""Mast collision: the cloth does not enter the pole that holds it.

The pole is a capsule: all points nearer than r to a segment. The segment runs from the first to the last pinned row of column 0,
layer 0, wherever these are now, and on below the first by a length h. After each step, for a particle at p from the nearest point
of the segment, moving at u relative to the pole there, n the unit normal where its path entered the pole, or p/|p| if it was
inside before:

    position:               p += (r - p.n) n   where p.n < r
    velocity, if u.n < 0:   u -= (1 + e) (u.n) n, and at most mu (1 + e) |u.n| off the sliding u - (u.n) n

The path p - u t, 0 <= t <= one step, is tested, so that no speed carries a particle across. Then the same for the cloth between
particles, p and u those of a point of it and w its particles' inverse masses, by their shares s of the point:

    position:               p_i += w_i s_i / (sum w s^2) (r - p.n) n
    velocity:               u_i  likewise, so that u changes as above

for edges and both diagonals of the cells, n across edge and pole, and for the cells' triangles where one of the pole's ends
enters them: no triangle takes the pole's axis between its corners, as long as r is a tenth of the spacing. Thinner poles leave
the pushes little space: at 2 to 6 % of the spacing, cloth whipped round the pole was seen to take it in, with self-collision,
whose pushes no velocity tells, or in single precision, about once in 4000 steps. Where pushes contradict each other, cloth
between particles may stay inside by less than r. Cells have links of `Structural` on all sides: without them, or torn, they are
no cloth, and the pole passes between the corners.

The pole moves as told and feels nothing. Pinned particles lie on the axis and, with the edges from them, are left alone; free
ones must stand outside at rest, so that r is less than the spacing. Forces and the step limit stay as they are. Effects that move
particles after the step (self-collision) belong before this one.

Parameters: radius r [m], below h [m], friction mu [1], restitution e [1]. Source: Bridson, Fedkiw, Anderson, Robust Treatment of
Collisions, Contact and Friction for Cloth Animation, SIGGRAPH 2002, section 4 (friction of a moving body).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit
from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.effects.contact import (
    SHALLOW,
    count_near_pole,
    dot,
    edges_near,
    keep_cells_out,
    keep_particles_out,
    push_particles_out,
    retrace,
    trace,
)
from flag_env.physics.effects.links import sides_of
from flag_env.physics.lattice import Lattice

TINY = 1e-30
"""Squared length [m^2] below which a vector has no direction."""


class MastCollisionData(NamedTuple):
    """The pole, and what of the cloth it meets.

    Attributes
    ----------
    foot, top
        Particles at the axis' ends.
    radius, below, bounce, friction, tiny, shallow
        Radius and length below the foot [m]; 1 + restitution; friction; least square [m^2]; depth, in radii, to leave.
    cols
        Columns of the lattice.
    offset : (4,)
        Second particle of an edge minus the first: along rows, up columns, both diagonals.
    outside : (particles,)
        Zero for the particles that at rest lie in the pole.
    edge : (4, particles)
        Zero where no edge starts, or one that at rest lies in the pole.
    cell : (particles,)
        Zero where no cell has its first corner, or one with a corner that at rest lies in the pole.
    links : (1 or copies, 2, particles)
        Weights of the links along rows and up columns; zero where broken.
    """

    foot: int
    top: int
    radius: Any
    below: Any
    bounce: Any
    friction: Any
    tiny: Any
    shallow: Any
    cols: int
    offset: NDArray[np.int64]
    outside: NDArray[np.uint8]
    edge: NDArray[np.uint8]
    cell: NDArray[np.uint8]
    links: NDArray[Any]

    @staticmethod
    @jit
    def project(data, copy, x, v, effect_work, inverse_mass, seconds):
        """Find the pole; look closer only if a particle or an edge may touch it."""
        h = x.dtype.type(seconds)
        one = x.dtype.type(1)
        n = x.shape[1]
        a, b = data.foot, data.top
        foot = x[0, a], x[1, a], x[2, a]
        axis = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
        speed = v[0, a], v[1, a], v[2, a]
        turn = v[0, b] - v[0, a], v[1, b] - v[1, a], v[2, b] - v[2, a]
        inverse = one / (dot(axis, axis) + data.tiny)
        low = -data.below * np.sqrt(inverse)
        length = np.sqrt(dot(axis, axis))
        frame = _frame(axis, length)
        ahead = _ahead(x, foot, frame, data.cols)
        near, behind = count_near_pole(
            x[0], x[1], x[2], v[0], v[1], v[2], inverse_mass, data.outside, foot, axis, speed, turn, ahead, inverse, low,
            data.radius, h, n,
        )  # fmt: skip
        p = effect_work[0, :n], effect_work[1, :n], effect_work[2, :n]
        q = effect_work[3, :n], effect_work[4, :n], effect_work[5, :n]
        reach = effect_work[0, n : 2 * n]
        pole = speed, turn, one / (length + data.tiny)
        cells = behind > 0 and data.radius > 0 and length * length > data.tiny
        cells = cells and edges_near(data, x, v, foot, frame, pole, h, p[0], p[1], reach)
        if cells:
            trace(
                x[0], x[1], x[2], v[0], v[1], v[2], foot, frame[0], frame[1], frame[2], speed, turn, pole[2], h,
                p[0], p[1], p[2], q[0], q[1], q[2], n,
            )  # fmt: skip
        if near:
            keep_particles_out(
                x, v, inverse_mass, foot, axis, speed, turn, inverse, low,
                data.radius, data.bounce, data.friction, data.tiny, h,
            )  # fmt: skip
        if cells:
            if near:
                retrace(x[0], x[1], x[2], foot, frame[0], frame[1], frame[2], data.radius, p[0], p[1], p[2], q[0], q[1], reach, n)
            links = data.links[copy % data.links.shape[0]]
            keep_cells_out(data, links, x, v, inverse_mass, frame, p, q, reach, pole, -data.below, length)
            push_particles_out(x, inverse_mass, foot, axis, inverse, low, data.radius)


@jit
def _ahead(x, foot, frame, cols):
    """Unit vector across the pole to about the middle of the cloth: of its lowest, its middle and its highest row."""
    zero = x.dtype.type(0)
    across, beside, _ = frame
    n = x.shape[1]
    a, b = zero, zero
    for first in (0, n // cols // 2 * cols, n - cols):
        for t in range(first, first + cols):
            p = x[0, t] - foot[0], x[1, t] - foot[1], x[2, t] - foot[2]
            a += dot(p, across)
            b += dot(p, beside)
    size = np.sqrt(a * a + b * b)
    scale = x.dtype.type(1) / size if size > 0 else zero
    a *= scale
    b *= scale
    return a * across[0] + b * beside[0], a * across[1] + b * beside[1], a * across[2] + b * beside[2]


@jit
def _frame(axis, length):
    """Three unit vectors at right angles, the last along the axis; of a mast of no length, none."""
    zero = length * 0
    one = zero + type(length)(1)
    scale = one / length if length > 0 else zero
    up = axis[0] * scale, axis[1] * scale, axis[2] * scale
    a = (-up[1], up[0], zero) if abs(up[2]) < abs(up[0]) + abs(up[1]) else (up[2], zero, -up[0])
    size = np.sqrt(dot(a, a))
    scale = one / size if size > 0 else zero
    a = a[0] * scale, a[1] * scale, a[2] * scale
    return a, (up[1] * a[2] - up[2] * a[1], up[2] * a[0] - up[0] * a[2], up[0] * a[1] - up[1] * a[0]), up


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
        super().__post_init__()
        object.__setattr__(self, "radius", _validate.number("radius", self.radius, minimum=0.0))
        for name in ("below", "friction", "restitution"):
            object.__setattr__(self, name, _validate.number(name, getattr(self, name), minimum=0.0))
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

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """It moves particles after a step, and adds no force."""
        del lattice
        return LinearBound()

    def bind(self, context: BindContext) -> MastCollisionData:
        """Constants in the scene's dtype, and the edges and cells that the pole may meet."""
        lattice, number = context.lattice, context.dtype.type
        foot, top = self.ends(lattice)
        sides = sides_of(context.links)
        links = np.zeros((1, 2, lattice.size), context.dtype) if sides is None else sides  # without links there is no cloth
        offset, outside, edge, cell = self._parts(lattice, foot)
        return MastCollisionData(
            foot=foot,
            top=top,
            radius=number(self.radius),
            below=number(self.below),
            bounce=number(1 + self.restitution),
            friction=number(self.friction),
            tiny=number(TINY),
            shallow=number(SHALLOW),
            cols=lattice.cols,
            offset=offset,
            outside=outside,
            edge=edge,
            cell=cell,
            links=links,
        )

    def _parts(self, lattice: Lattice, foot: int) -> tuple[NDArray[Any], ...]:
        """Offsets of the edges' families, and which particles, edges and cells at rest are outside the pole."""
        rest, cols = lattice.rest_positions.reshape(-1, 3), lattice.cols
        inside = (np.hypot(*(rest - rest[foot])[:, :2].T) <= self.radius).reshape(lattice.shape)
        first = np.arange(lattice.size).reshape(lattice.shape)
        offset = np.array([1, cols, cols + 1, cols - 1])
        edge, cell = np.zeros((4, lattice.size), np.uint8), np.zeros(lattice.size, np.uint8)
        ends = [
            (np.s_[:, :, :-1], np.s_[:, :, 1:]),
            (np.s_[:, :-1], np.s_[:, 1:]),
            (np.s_[:, :-1, :-1], np.s_[:, 1:, 1:]),
            (np.s_[:, :-1, 1:], np.s_[:, 1:, :-1]),
        ]
        for row, (one, two) in zip(edge, ends, strict=True):
            row[first[one][~(inside[one] | inside[two])]] = 1
        corners = [inside[:, down : down - 1 or None, right : right - 1 or None] for down in (0, 1) for right in (0, 1)]
        cell[first[:, :-1, :-1][~np.any(corners, axis=0)]] = 1
        return offset, (~inside).ravel().astype(np.uint8), edge, cell
