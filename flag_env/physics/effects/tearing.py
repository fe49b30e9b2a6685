"""Tearing: a link whose strain d/l - 1 exceeds a given one after a step breaks and exerts no force from then on.

Links of `Structural`, `Shear`, `Bending` and `CrossLayer` break, those that the scene has. A broken link's weight is zero, in
each copy on its own: the force pass is that of an intact cloth. It never mends, but in an earlier state that is set again.

A shear or bending link stands for the cloth between its ends. Where the scene has structural links, it goes with the last
unbroken way over two of them: a bending link with either of the two it spans, a shear link once both ways round its cell are
cut. Links across layers break by their own strain alone. On a rope, in one dimension, a link's length is that of the slanted
line, sqrt(l^2 + (z_b - z_a)^2).

A broken structural link is free of `StrainLimit` as well, which otherwise keeps links from the strain at which they would break
if its stretch is the smaller of the two and it stands earlier among the scene's effects. A cell with a torn side feels no
pressure of the air. Damping that an integrator has solved beforehand goes on acting on broken links.

Parameters: strain [1]. Source: Terzopoulos and Fleischer, Modeling inelastic deformation: viscoelasticity, plasticity, fracture,
SIGGRAPH 1988, section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.lattice import SIDES, Direction, Lattice


@kernel
def _square(out, p, pb, n):
    for t in range(n):
        e = pb[t] - p[t]
        out[t] = e * e


@kernel
def _add_square(out, p, pb, n):
    for t in range(n):
        e = pb[t] - p[t]
        out[t] += e * e


@jit
def _squared_lengths(x, offset, out):
    """Squared distance of every particle to the one `offset` further on [m^2]."""
    n = x.shape[1] - offset
    _square(out, x[0], x[0, offset:], n)
    for d in range(1, x.shape[0]):
        _add_square(out, x[d], x[d, offset:], n)


@kernel
def _count(square, weight, most, n):
    over = 0
    for t in range(n):
        over += (square[t] > most) & (weight[t] != 0)
    return over


@kernel
def _cut(square, weight, most, n):
    for t in range(n):
        if square[t] > most:
            weight[t] = 0


@jit
def _tear(x, weight, offset, most, effect_work):
    """Break the links of one effect in one copy that are too long; return how many."""
    broken = 0
    for j in range(weight.shape[0]):
        o = offset[j]
        n = x.shape[1] - o
        _squared_lengths(x, o, effect_work[0])
        over = _count(effect_work[0], weight[j], most[j], n)
        if over > 0:
            _cut(effect_work[0], weight[j], most[j], n)
            broken += over
    return broken


@jit
def _sever(weight, structural, ways):
    """Break the links of one effect in one copy that no way over two structural links spans any more."""
    for j in range(weight.shape[0]):
        for t in range(weight.shape[1]):
            if weight[j, t] != 0:
                whole = False
                for way in range(2):
                    unbroken = True
                    for link in range(2):
                        family, shift = ways[j, way, link, 0], ways[j, way, link, 1]
                        unbroken = unbroken and structural[family, t + shift] != 0
                    whole = whole or unbroken
                if not whole:
                    weight[j, t] = 0


class TearingData(NamedTuple):
    """What holds in each copy, and what it may bear.

    Attributes
    ----------
    weights : one (copies, families, particles) for each effect with links
        The weights that those effects use, zero where broken.
    offset : (effects, families)
        Second particle of a link minus the first.
    most : (effects, families)
        Squared length at which a link breaks [m^2].
    structural
        Which of the effects has the links of a cell's sides; -1 where none has.
    spanned : (effects,)
        Whether an effect's links go with the last way over structural links.
    ways : (effects, families, 2, 2, 2)
        Two ways over two structural links each, as (family, first particle minus that of the link).
    """

    weights: tuple[NDArray[Any], ...]
    offset: NDArray[np.int64]
    most: NDArray[Any]
    structural: int
    spanned: NDArray[np.bool_]
    ways: NDArray[np.int64]

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return ("weights",)

    @staticmethod
    @jit
    def project(data, copy, x, v, effect_work, inverse_mass, seconds):
        """Break what is too long, and what that leaves without hold."""
        broken = 0
        for group in range(len(data.weights)):
            torn = _tear(x, data.weights[group][copy], data.offset[group], data.most[group], effect_work)
            if group == data.structural:
                broken = torn
        if broken > 0:
            sides = data.weights[data.structural][copy]
            for group in range(len(data.weights)):
                if data.spanned[group]:
                    _sever(data.weights[group][copy], sides, data.ways[group])


@dataclass(frozen=True)
class Tearing(Effect):
    """Links that break for good when stretched too far.

    Parameters
    ----------
    strain
        Of a link when it breaks, > 0; infinite: none breaks.
    """

    breaks: ClassVar[bool] = True

    strain: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "strain", _validate.number("strain", self.strain, above=0.0, infinite=True))

    @property
    def smooth(self) -> bool:
        """A link breaks at the end of a step."""
        return False

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """It only takes links away."""
        del lattice
        return LinearBound()

    def bind(self, context: BindContext) -> TearingData:
        """What each link of the scene's other effects may bear."""
        lattice, groups = context.lattice, context.links
        families = max((len(group.families) for group in groups), default=0)
        offset, most = np.zeros((len(groups), families), np.int64), np.zeros((len(groups), families), context.dtype)
        ways, spanned = np.zeros((len(groups), families, 2, 2, 2), np.int64), np.zeros(len(groups), bool)
        sides = [i for i, group in enumerate(groups) if set(group.directions) & set(SIDES)]
        least = 1.0 if lattice.dimensions == 1 else 0.0  # on a rope a link is as long as its displacement alone
        for i, group in enumerate(groups):
            known = [_ways(lattice, direction) for direction in group.directions]
            spanned[i] = bool(sides) and bool(known) and all(way is not None for way in known)
            for j, (family, way) in enumerate(zip(group.families, known, strict=True)):
                offset[i, j] = family.offset
                most[i, j] = ((1 + self.strain) ** 2 - least) * family.length**2
                if spanned[i] and way is not None:
                    ways[i, j] = way
        weights = tuple(group.weight for group in groups) or (np.zeros((context.copies, 0, lattice.size), context.dtype),)
        if not groups:
            offset, most, spanned = np.zeros((1, 0), np.int64), np.zeros((1, 0), context.dtype), np.zeros(1, bool)
        return TearingData(weights, offset, most, sides[0] if sides else -1, spanned, ways)


def _ways(lattice: Lattice, direction: Direction) -> list[list[tuple[int, int]]] | None:
    """The two ways over two structural links between the ends of a link in this direction; None where there are none."""
    along, row = 0, lattice.cols
    up = len(lattice.families(SIDES[0]))  # a lattice of one column has no links along rows
    return {
        (0, 0, 2): 2 * [[(along, 0), (along, 1)]],
        (0, 2, 0): 2 * [[(up, 0), (up, row)]],
        (0, 1, 1): [[(along, 0), (up, 1)], [(up, 0), (along, row)]],
        (0, 1, -1): [[(along, -1), (up, -1)], [(up, 0), (along, row - 1)]],
    }.get(direction)
