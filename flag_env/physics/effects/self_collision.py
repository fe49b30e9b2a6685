"""Self-collision: particles far apart in the lattice keep a distance, so that no cloth passes through cloth.

After each step, one pair after the other, where the distance d of two particles is below their reach D = min(thickness, 0.7 l),
l their distance at rest, n the direction from 1 to 2, w = 1/m (zero if pinned) and v = v2 - v1:

    positions:   x1 -= w1 (D - d)/(w1 + w2) n,   x2 += w2 (D - d)/(w1 + w2) n
    velocities, if v.n < 0:   J = -(1 + e) v.n / (w1 + w2) along n,   at most mu J against the sliding v - (v.n) n

Both keep momentum. Angular momentum is not kept, since particles at a distance that brake or move each other do not turn: in a
crowd it changed by 0.4 (without friction) to 0.5 % of the sum of |x| m |v| within 300 steps.
Neighbours along rows, columns and diagonals of one layer are left to their
springs. The reach lies above the spacing, which closes the meshes although only particles are tested. Cloth stretched to about
twice its length leaks (seen with 40 x 64 particles in a wind of some 30 m/s): take a larger thickness there, 1.6 spacings held.
Nothing is swept: particles of sheets that lie shifted against each other may pass cells between two steps. At a tenth of a
thickness a step 1 of 240 looks at such sheets without friction found a crossing, at half of it 31; with friction some do too.
Forces and the step limit stay as they are.

A push does work against the springs, which an impact must take out: restitution above MOST_RESTITUTION makes energy.

Parameters: thickness [m], friction mu [1], restitution e [1]. The pairs come from a list (Verlet 1967) of those nearer than the
thickness and a skin, made anew by `blocks` or `cells` once a particle has moved by half the skin. The list can hold
four layers of cloth; where more meet, every step searches anew, and no pair is left out. Sources: Bridson, Fedkiw,
Anderson, Robust Treatment of Collisions, Contact and Friction for Cloth Animation, SIGGRAPH 2002 (impulses, friction); Mueller
et al., Position Based Dynamics, J. Vis. Commun. 2007 (positions).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flag_env import _validate
from flag_env.physics.compiling import jit
from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.effects.contact import (
    Blocks,
    blocks_of,
    codes,
    copy_into,
    count_different,
    count_moved,
    make_list,
    table_size,
    treat_pairs,
)
from flag_env.physics.lattice import Lattice

THICKNESS = 1.2
"""Default thickness, in spacings; 1.0 was found to leak in the strongest winds."""

SHARE = 0.7
"""Part of its rest distance to which a pair may come near, however thick the cloth: the rest pose is free of contact."""

SKIN = 0.5
"""How far beyond the thickness pairs are listed, in spacings."""

LEAST, MOST = 24, 256
"""Pairs listed per particle, at least and at most: what is more is searched anew in every step, slower and to the same bits."""

FOLDS = 4
"""Layers of cloth, each as dense as the scene's at rest, whose pairs the list can hold."""

MOST_RESTITUTION = 0.7
"""Undamped cloth thrown at 5 to 60 m/s keeps or loses energy at 0.7, up to 0.7 of its step limit; at 0.8 it gains it there."""

TINY = 1e-30
"""Squared distance [m^2] below which two particles have no direction and part along y, the rest pose's normal."""


class SelfCollisionData(NamedTuple):
    """Contact constants, each copy's list of pairs, and memory to make it in.

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
        The list, (copies, 2, capacity), and how long it is, (copies,); -1 where it does not hold all.
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
    def project(data, copy, x, v, effect_work, inverse_mass, seconds):
        """Renew the list if need be, then treat its pairs."""
        n = x.shape[1]
        reference, listed = data.reference[copy], data.listed[copy]
        stale = count_moved(x[0], x[1], x[2], reference[0], reference[1], reference[2], data.limit, n)
        if stale:
            for d in range(3):
                copy_into(reference[d], x[d], n)
        else:
            for d in range(3):  # another state was set
                stale += count_different(reference[d], listed[d], n)
        if stale:
            make_list(data, copy, effect_work)
        treat_pairs(data, copy, x, v, effect_work, inverse_mass)


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
        Share of the approach velocity with which particles part, 0 to 0.7: above, contact makes energy.
    """

    rank: ClassVar[int] = 1

    thickness: float | None = None
    friction: float = 0.3
    restitution: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thickness is not None:
            object.__setattr__(self, "thickness", _validate.number("thickness", self.thickness, minimum=0.0))
        object.__setattr__(self, "friction", _validate.number("friction", self.friction, minimum=0.0))
        object.__setattr__(self, "restitution", _validate.number("restitution", self.restitution, minimum=0.0))
        if self.restitution > MOST_RESTITUTION:
            raise ValueError(
                f"restitution must be at most {MOST_RESTITUTION}, since contact makes energy above, got {self.restitution!r}"
            )

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
        return THICKNESS * max(lattice.spacings[:2]) if self.thickness is None else self.thickness

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """It moves particles after a step, and adds no force."""
        del lattice
        return LinearBound()

    @staticmethod
    def capacity(lattice: Lattice, reach: float) -> int:
        """Pairs that a copy's list can hold; reach [m], within which pairs are listed."""
        n = lattice.size
        rest = cKDTree(lattice.rest_positions.reshape(-1, 3))
        near = (rest.count_neighbors(rest, reach) - n) / (2 * n)  # pairs per particle of the cloth at rest
        return int(min(n * (n - 1) // 2, n * min(max(np.ceil(FOLDS * near), LEAST), MOST)))

    def bind(self, context: BindContext) -> SelfCollisionData:
        """Constants in the scene's dtype and empty lists."""
        lattice, copies, dtype = context.lattice, context.copies, context.dtype
        number, n = dtype.type, lattice.size
        thickness, skin = self.reach(lattice), SKIN * max(lattice.spacings[:2])
        capacity = self.capacity(lattice, thickness + skin)
        code, free = codes(lattice.shape, _neighbours(lattice))
        rest = np.ascontiguousarray(lattice.rest_positions.reshape(-1, 3).T, dtype)
        return SelfCollisionData(
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
            pairs=np.zeros((copies, 2, capacity), np.uint32),
            listed_pairs=np.zeros(copies, np.int64),
            start=np.zeros((copies, table_size(n) + 1), np.uint32),
            place=np.zeros((copies, n + 1), np.uint32),
            order=np.zeros((copies, n), np.uint32),
            column=np.zeros((copies, n), np.int64),
        )


def _neighbours(lattice: Lattice) -> NDArray[np.bool_]:
    """Which places around a particle, by rows and columns, are too near at rest to collide: as near as a cell's diagonal."""
    along, up, _ = lattice.spacings
    nearest = 1.01 * np.hypot(along, up)
    rows, cols = int(nearest / up), int(nearest / along)
    down, right = np.mgrid[-rows : rows + 1, -cols : cols + 1]
    return np.asarray(np.hypot(down * up, right * along) <= nearest)
