"""Self-collision: particles far apart in the lattice keep a distance, so that no cloth passes through cloth.

After each step, one pair after the other, where the distance d of two particles is below their reach D = min(thickness, 0.7 l),
l their distance at rest, n the direction from 1 to 2, w = 1/m (zero if pinned) and v = v2 - v1:

    positions:   x1 -= w1 (D - d)/(w1 + w2) n,   x2 += w2 (D - d)/(w1 + w2) n
    velocities, if v.n < 0:   J = -(1 + e) v.n / (w1 + w2) along n,   at most mu J against the sliding v - (v.n) n

Both keep momentum. Neighbours along rows, columns and diagonals of one layer are left to their springs. The reach lies above the
spacing, which closes the meshes although only particles are tested. Cloth stretched to about twice its length leaks (seen with
40 x 64 particles in a wind of some 30 m/s): take a larger thickness there, 1.6 spacings held. An approach by more than a
thickness in one step is missed. Forces and the step limit stay as they are.

Parameters: thickness [m], friction mu [1], restitution e [1]. The pairs come from a list (Verlet 1967) of those nearer than the
thickness and a skin, made anew by `blocks` or `cells` once a particle has moved by half the skin. Sources: Bridson, Fedkiw,
Anderson, Robust Treatment of Collisions, Contact and Friction for Cloth Animation, SIGGRAPH 2002 (impulses, friction); Mueller
et al., Position Based Dynamics, J. Vis. Commun. 2007 (positions).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import validate
from flag_env.physics.effects.base import Effect, Setting
from flag_env.physics.effects.blocks import Blocks, blocks_of, codes, find_pairs_by_blocks
from flag_env.physics.effects.cells import copy_into, count_different, count_moved, find_pairs, sort_into_cells, table_size
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Lattice

THICKNESS = 1.2
"""Thickness unless told, in spacings; 1.0 was found to leak in the strongest winds."""

SHARE = 0.7
"""Part of its rest distance to which a pair may come near, however thick the cloth: the rest pose is free of contact."""

SKIN = 0.5
"""How far beyond the thickness pairs are listed, in spacings."""

ROOM = 24
"""Pairs listed per particle at most; only a cloth squeezed to a point has more, and then as many as fit are pushed apart."""

TINY = 1e-30
"""Squared distance [m^2] below which two particles have no direction and part along y, the rest pose's normal."""


@kernel
def _separate(x, y, z, u, v, w, one, two, count, inverse_mass, rx, ry, rz, thickness, share, bounce, friction, tiny):
    """Push apart the pairs that are too near, stop their approach and brake their sliding."""
    zero = x.dtype.type(0)
    near = thickness * thickness
    for c in range(count):
        i, j = one[c], two[c]
        dx = x[j] - x[i]
        dy = y[j] - y[i]
        dz = z[j] - z[i]
        d2 = dx * dx + dy * dy + dz * dz
        if not d2 < near:
            continue
        lx = rx[j] - rx[i]
        ly = ry[j] - ry[i]
        lz = rz[j] - rz[i]
        reach = min(thickness, share * np.sqrt(lx * lx + ly * ly + lz * lz))
        d = np.sqrt(d2)
        wi, wj = inverse_mass[i], inverse_mass[j]
        total = wi + wj
        if not d < reach or total == 0:
            continue
        if d2 > tiny:
            dx /= d
            dy /= d
            dz /= d
        else:
            d, dx, dy, dz = zero, zero, zero + x.dtype.type(1), zero
        push = (reach - d) / total
        x[i] -= wi * push * dx
        y[i] -= wi * push * dy
        z[i] -= wi * push * dz
        x[j] += wj * push * dx
        y[j] += wj * push * dy
        z[j] += wj * push * dz
        du = u[j] - u[i]
        dv = v[j] - v[i]
        dw = w[j] - w[i]
        rate = du * dx + dv * dy + dw * dz
        if not rate < 0:
            continue
        impulse = -bounce * rate / total
        du -= rate * dx
        dv -= rate * dy
        dw -= rate * dz
        slide = np.sqrt(du * du + dv * dv + dw * dw)
        brake = zero
        if slide > 0:
            brake = min(friction * impulse, slide / total) / slide
        px = impulse * dx - brake * du
        py = impulse * dy - brake * dv
        pz = impulse * dz - brake * dw
        u[i] -= wi * px
        v[i] -= wi * py
        w[i] -= wi * pz
        u[j] += wj * px
        v[j] += wj * py
        w[j] += wj * pz


class BoundSelfCollision(NamedTuple):
    """Contact constants, each copy's list of pairs, and room to make it.

    Attributes
    ----------
    rest : (3, particles)
        Rest positions [m].
    thickness, share, bounce, friction, tiny
        As in the formulas above; bounce = 1 + e.
    reach, limit, per_cell
        Distance of listed pairs [m]; square of half the skin [m^2]; cells per metre.
    code, free
        Each particle's number in the lattice; which differences of it belong to no neighbours.
    blocks
        The lattice in blocks of neighbours.
    reference : (copies, 3, particles)
        Positions that the list is to be of. All that a continuation depends on: the list follows from it.
    listed : (copies, 3, particles)
        Positions that the list is of.
    pairs, listed_pairs
        The list, (copies, 2, room), and how long it is, (copies,).
    start, place, order, column
        What `cells` works in.
    """

    rest: NDArray[Any]
    thickness: Any
    share: Any
    bounce: Any
    friction: Any
    tiny: Any
    reach: Any
    limit: Any
    per_cell: Any
    code: NDArray[np.uint32]
    free: NDArray[np.uint8]
    blocks: Blocks
    reference: NDArray[Any]
    listed: NDArray[Any]
    pairs: NDArray[np.uint32]
    listed_pairs: NDArray[np.int64]
    start: NDArray[np.uint32]
    place: NDArray[np.uint32]
    order: NDArray[np.uint32]
    column: NDArray[np.int64]

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes and goes on from."""
        return ("reference",)

    @staticmethod
    @jit
    def project(bound, copy, x, v, scratch, inverse_mass, seconds):
        """Renew the list if need be, then treat its pairs."""
        n = x.shape[1]
        reference, listed = bound.reference[copy], bound.listed[copy]
        stale = count_moved(x[0], x[1], x[2], reference[0], reference[1], reference[2], bound.limit, n)
        if stale:
            for d in range(3):
                copy_into(reference[d], x[d], n)
        else:
            for d in range(3):  # another state was set
                stale += count_different(reference[d], listed[d], n)
        if stale:
            _make_list(bound, copy, scratch)
        _separate(
            x[0], x[1], x[2], v[0], v[1], v[2],
            bound.pairs[copy, 0], bound.pairs[copy, 1], bound.listed_pairs[copy], inverse_mass,
            bound.rest[0], bound.rest[1], bound.rest[2], bound.thickness, bound.share, bound.bounce, bound.friction, bound.tiny,
        )  # fmt: skip


@jit
def _make_list(bound, copy, scratch):
    """List the pairs of the reference positions."""
    n = bound.rest.shape[1]
    listed = bound.listed[copy]
    for d in range(3):
        copy_into(listed[d], bound.reference[copy, d], n)
    start, place, order, column = bound.start[copy], bound.place[copy], bound.order[copy], bound.column[copy]
    count = find_pairs_by_blocks(
        listed, bound.blocks, bound.code, bound.free, bound.reach, start, place, order, column, bound.pairs[copy], scratch
    )
    if count < 0:
        finite = sort_into_cells(
            listed[0], listed[1], listed[2], bound.per_cell, start, place, order, column, scratch[0], scratch[1], scratch[2], n
        )
        count = find_pairs(
            scratch[0], scratch[1], scratch[2], bound.per_cell, start, place, order, column,
            bound.code, bound.free, bound.reach, bound.pairs[copy, 0], bound.pairs[copy, 1], finite,
        )  # fmt: skip
    bound.listed_pairs[copy] = count


@dataclass(frozen=True)
class SelfCollision(Effect):
    """Contact of the cloth with itself.

    Parameters
    ----------
    thickness
        Distance that particles keep [m], >= 0; None: 1.2 of the larger spacing. Below the spacing of the cloth as stretched,
        cloth may slip between the particles; at 0 nothing ever touches.
    friction
        Coefficient of friction, >= 0.
    restitution
        Share of the approach velocity with which particles part, 0 to 1.
    """

    rank: ClassVar[int] = 1

    thickness: float | None = None
    friction: float = 0.3
    restitution: float = 0.0

    def __post_init__(self) -> None:
        if self.thickness is not None:
            object.__setattr__(self, "thickness", validate.number("thickness", self.thickness, minimum=0.0))
        object.__setattr__(self, "friction", validate.number("friction", self.friction, minimum=0.0))
        object.__setattr__(self, "restitution", validate.number("restitution", self.restitution, minimum=0.0))
        if self.restitution > 1:
            raise ValueError(f"restitution must be at most 1, got {self.restitution!r}")

    @property
    def smooth(self) -> bool:
        """Contact begins and ends."""
        return False

    def check(self, lattice: Lattice) -> None:
        """Cloth that moves in its plane has no sides to touch with."""
        if lattice.dimensions != 3:
            raise ValueError(f"SelfCollision must act in 3 dimensions, got a lattice with dimensions={lattice.dimensions}")

    def reach(self, lattice: Lattice) -> float:
        """The thickness, derived from the lattice unless given [m]."""
        return THICKNESS * max(lattice.steps[:2]) if self.thickness is None else self.thickness

    def bind(self, setting: Setting) -> BoundSelfCollision:
        """Constants in the scene's dtype and empty lists."""
        lattice, copies, dtype = setting.lattice, setting.copies, setting.dtype
        number, n = dtype.type, lattice.size
        thickness, skin = self.reach(lattice), SKIN * max(lattice.steps[:2])
        room = min(n * (n - 1) // 2, ROOM * n)
        code, free = codes(lattice.shape, _neighbours(lattice))
        rest = np.ascontiguousarray(lattice.rest_positions.reshape(-1, 3).T, dtype)
        return BoundSelfCollision(
            rest=rest,
            thickness=number(thickness),
            share=number(SHARE),
            bounce=number(1 + self.restitution),
            friction=number(self.friction),
            tiny=number(TINY),
            reach=number(thickness + skin),
            limit=number((0.5 * skin) ** 2),
            per_cell=number(0.999 / (thickness + skin)),  # spare for rounding
            code=code,
            free=free,
            blocks=blocks_of(lattice, dtype),
            reference=np.tile(rest, (copies, 1, 1)),
            listed=np.full((copies, 3, n), np.nan, dtype),  # equal to nothing: the first step makes the list
            pairs=np.zeros((copies, 2, room), np.uint32),
            listed_pairs=np.zeros(copies, np.int64),
            start=np.zeros((copies, table_size(n) + 1), np.uint32),
            place=np.zeros((copies, n + 1), np.uint32),
            order=np.zeros((copies, n), np.uint32),
            column=np.zeros((copies, n), np.int64),
        )


def _neighbours(lattice: Lattice) -> NDArray[np.bool_]:
    """Which places around a particle, by rows and columns, are too near at rest to collide: as near as a cell's diagonal."""
    along, up, _ = lattice.steps
    nearest = 1.01 * np.hypot(along, up)
    rows, cols = int(nearest / up), int(nearest / along)
    down, right = np.mgrid[-rows : rows + 1, -cols : cols + 1]
    return np.asarray(np.hypot(down * up, right * along) <= nearest)
