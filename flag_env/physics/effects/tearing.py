"""Tearing: a link whose strain d/l - 1 exceeds a given one after a step breaks and exerts no force from then on.

Links of `Structural`, `Shear`, `Bending` and `CrossLayer` break, those that the scene has. A broken link's weight is zero, in
each copy on its own: the force pass is that of an intact cloth. It never mends, but in an earlier state that is set again.

A shear or bending link stands for the cloth between its ends. Where the scene has structural links, it goes with the last
unbroken way over two of them: a bending link with either of the two it spans, a shear link once both ways round its cell are
cut. Links across layers break by their own strain alone. On a rope, in one dimension, a link's length is that of the slanted
line, sqrt(l^2 + (z_b - z_a)^2).

A broken structural link is free of `StrainLimit` as well, which otherwise keeps links from the strain at which they would break
if its stretch is the smaller of the two and it stands earlier among the scene's effects. Pressure of the air goes on acting on
torn cells, and damping that an integrator has solved beforehand on broken links.

Parameters: strain [1]. Source: Terzopoulos and Fleischer, Modeling inelastic deformation: viscoelasticity, plasticity, fracture,
SIGGRAPH 1988, section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import validate
from flag_env.physics.effects.base import Effect, Setting
from flag_env.physics.effects.bending import Bending
from flag_env.physics.effects.cross_layer import CrossLayer
from flag_env.physics.effects.shear import Shear
from flag_env.physics.effects.springs import LinkEffect
from flag_env.physics.effects.strain_limit import StrainLimit
from flag_env.physics.effects.structural import Structural
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Lattice, Step

KINDS: tuple[type[LinkEffect], ...] = (Structural, Shear, Bending, CrossLayer)


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
def _tear(x, weight, offset, most, scratch):
    """Break the links of one effect in one copy that are too long; return how many."""
    broken = 0
    for j in range(weight.shape[0]):
        o = offset[j]
        n = x.shape[1] - o
        _squared_lengths(x, o, scratch[0])
        over = _count(scratch[0], weight[j], most[j], n)
        if over > 0:
            _cut(scratch[0], weight[j], most[j], n)
            broken += over
    return broken


@jit
def _sever(weight, structural, ways):
    """Break the links of one effect in one copy that no way over two structural links spans any more."""
    for j in range(ways.shape[0]):
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


class BoundTearing(NamedTuple):
    """What holds in each copy, and what it may bear.

    Attributes
    ----------
    structural, shear, bending, cross_layer : (copies, families, particles)
        Weights that the effects of these names use, zero where broken; no families where the scene has no such effect.
    offset : (4, families)
        Second particle of a link minus the first.
    most : (4, families)
        Squared length at which a link breaks [m^2].
    shear_ways, bending_ways : (families, 2, 2, 2)
        Two ways over two structural links each, as (family, first particle minus that of the link); no families where the scene
        has no structural links.
    """

    structural: NDArray[Any]
    shear: NDArray[Any]
    bending: NDArray[Any]
    cross_layer: NDArray[Any]
    offset: NDArray[np.int64]
    most: NDArray[Any]
    shear_ways: NDArray[np.int64]
    bending_ways: NDArray[np.int64]

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return "structural", "shear", "bending", "cross_layer"

    @staticmethod
    @jit
    def project(bound, copy, x, v, scratch, inverse_mass, seconds):
        """Break what is too long, and what that leaves without hold."""
        structural, shear, bending = bound.structural[copy], bound.shear[copy], bound.bending[copy]
        broken = _tear(x, structural, bound.offset[0], bound.most[0], scratch)
        _tear(x, shear, bound.offset[1], bound.most[1], scratch)
        _tear(x, bending, bound.offset[2], bound.most[2], scratch)
        _tear(x, bound.cross_layer[copy], bound.offset[3], bound.most[3], scratch)
        if broken > 0:
            _sever(shear, structural, bound.shear_ways)
            _sever(bending, structural, bound.bending_ways)


@dataclass(frozen=True)
class Tearing(Effect):
    """Links that break for good when stretched too far.

    Parameters
    ----------
    strain
        Of a link when it breaks, > 0; infinite: none breaks.
    """

    binds_last: ClassVar[bool] = True
    breaks: ClassVar[bool] = True

    strain: float = 0.3

    def __post_init__(self) -> None:
        object.__setattr__(self, "strain", validate.number("strain", self.strain, above=0.0, infinite=True))

    @property
    def smooth(self) -> bool:
        """A link breaks at the end of a step."""
        return False

    def bind(self, setting: Setting) -> BoundTearing:
        """Give every copy link weights of its own, in place of those that the effects share among copies."""
        lattice, dtype, bound = setting.lattice, setting.dtype, setting.bound
        offset, most = np.zeros((len(KINDS), 5), np.int64), np.zeros((len(KINDS), 5), dtype)
        weights = []
        for row, kind in enumerate(KINDS):
            weight = np.zeros((setting.copies, 0, lattice.size), dtype)
            if kind in bound:
                weight = np.repeat(bound[kind].weight, setting.copies, axis=0)
                bound[kind] = bound[kind]._replace(weight=weight)
                for j, family in enumerate(lattice.families(*kind.steps)):
                    offset[row, j] = family.offset
                    # on a rope a link is as long as its displacement alone
                    least = 1.0 if lattice.dimensions == 1 else 0.0
                    most[row, j] = ((1 + self.strain) ** 2 - least) * family.length**2
            weights.append(weight)
        if StrainLimit in bound and Structural in bound:
            bound[StrainLimit] = bound[StrainLimit]._replace(weight=weights[0])
        shear_ways, bending_ways = (
            _ways(lattice, kind.steps) if {Structural, kind} <= set(bound) else _NO_WAYS for kind in (Shear, Bending)
        )
        structural, shear, bending, cross_layer = weights
        return BoundTearing(structural, shear, bending, cross_layer, offset, most, shear_ways, bending_ways)


_NO_WAYS = np.zeros((0, 2, 2, 2), np.int64)


def _ways(lattice: Lattice, steps: tuple[Step, ...]) -> NDArray[np.int64]:
    """The two ways over two structural links between the ends of each family's links."""
    along = 0
    up = len(lattice.families(Structural.steps[0]))  # a lattice of one column has no links along rows
    row = lattice.cols
    ways = {
        (0, 0, 2): 2 * [[(along, 0), (along, 1)]],
        (0, 2, 0): 2 * [[(up, 0), (up, row)]],
        (0, 1, 1): [[(along, 0), (up, 1)], [(up, 0), (along, row)]],
        (0, 1, -1): [[(along, -1), (up, -1)], [(up, 0), (along, row - 1)]],
    }
    present = [ways[step] for step in steps if lattice.families(step)]
    return np.array(present, np.int64).reshape(-1, 2, 2, 2)
