"""Strain limit: no structural link is longer than (1 + s) times its rest length after a step (after Provot 1995).

A pose x that a step has reached goes over to an admissible one, |x_b - x_a| <= L = (1 + s) l for every link, near the nearest:

    x' ~ argmin sum_i m_i |x'_i - x_i|^2 ,   v' = v + (x' - x) / h

It pulls both ends of a link by opposite impulses, so momentum is kept. The admissible poses are a convex set, so that kinetic
energy never grows but for the tolerance below; a cloth within the limit keeps every bit. Springs stay as soft as they are, and
with them the timestep.

Provot moves one link at a time, which carries a pull one link further a sweep. Here all links of a row, then all of a column,
are solved at once. On one line, with n_i the links' directions, c_i = d_i - L, w the inverse masses,

    T p = c ,  T_ii = w_i + w_i+1 ,  T_i,i+1 = min(0, -w_i+1 n_i.n_i+1) ,  p >= 0 ,  x'_i = x_i + w_i (p_i n_i - p_i-1 n_i-1)

which is tridiagonal. T is an M-matrix, so that dropping slack links with p < 0 ends with all p >= 0; leaving out its positive
elements (folds) keeps 2 T - J W J' semi-definite, so that no pass moves the pose away from any admissible one. Rows and columns
are treated in turn until no link is longer than L (1 + TOLERANCE), at most `iterations` times. A step is counted where one still
is.

A pose that is beyond the limit before a step (as placed by hand) is shortened first, without a change of velocity. Where the
mast makes the limit impossible, as two pinned ends too far apart do, the links stay longer, the lightest most, and the result is
finite; a mast that jumps by more than the flag's size in a step may take it some steps to bring back within the limit. The limit
holds where no later effect of the scene moves particles after a step. On a rope, in one dimension, a link's length is that of
the slanted line, sqrt(l^2 + (z_b - z_a)^2).

Parameters: stretch s [1]; iterations. Sources: Provot, Deformation constraints in a mass-spring model, Graphics Interface 1995;
Mueller et al., Position based dynamics, 2007; Bauschke and Borwein, On projection algorithms for convex feasibility, 1996.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit
from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.effects.strain import holds, shorten
from flag_env.physics.lattice import SIDES, Family, Lattice

TOLERANCE = 1e-3
"""Excess over the longest length, relative to it, that is left."""


class StrainLimitData(NamedTuple):
    """Limits and lines of the families along rows and up columns.

    Attributes
    ----------
    offset : (families,)
        Second particle of a link minus the first.
    limit : (families,)
        Longest length [m].
    weight : (1 or copies, families, particles)
        Zero where no link starts.
    start : (families, lines)
        First particles of the lines.
    lines, links : (families,)
        Number of lines, and of links in one.
    large
        A pull of this times a length may turn links [kg].
    tolerance
        Relative excess that is left.
    iterations
        Most passes over rows and columns.
    missed : (copies,)
        Number of steps after which a link was left longer.
    work : (copies, 4, particles)
        Scratch for the links of one family.
    """

    offset: NDArray[np.int64]
    limit: NDArray[Any]
    weight: NDArray[Any]
    start: NDArray[np.int64]
    lines: NDArray[np.int64]
    links: NDArray[np.int64]
    large: Any
    tolerance: Any
    iterations: int
    missed: NDArray[np.int64]
    work: NDArray[Any]

    @staticmethod
    @jit
    def project(data, copy, x, v, effect_work, inverse_mass, seconds):
        """Shorten what was too long before the step, without a change of velocity, then what the step made too long.

        Of the latter every excess at first, then what is beyond the tolerance; rows and columns in turn.
        """
        number = x.dtype.type
        weight = data.weight[copy % data.weight.shape[0]]
        lag, rate, slack = number(seconds), number(0), data.tolerance
        busy = False
        for _ in range(2):
            for _ in range(data.iterations):
                busy = False
                for j in range(data.offset.shape[0]):
                    if shorten(data, j, data.work[copy], x, v, lag, rate, weight[j], effect_work, inverse_mass, slack):
                        busy = True
                if not busy:
                    break
                slack = data.tolerance
            lag, rate, slack = number(0), number(1 / seconds), number(0)
        if busy and not holds(data, x, v, weight, inverse_mass, data.work[copy]):
            data.missed[copy] += 1


@dataclass(frozen=True)
class StrainLimit(Effect):
    """A longest length for every structural link, kept after each step.

    Parameters
    ----------
    stretch
        Largest strain s of a link, >= 0; infinite: no limit.
    iterations
        Most passes over rows and columns in a step; it stops as soon as the limit holds to one part in a thousand, mostly after
        less than ten. Steps that need more are counted by `Simulator.strain_limit_misses`, and the first of them warns.
    """

    stretch: float = 0.1
    iterations: int = 1000

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "stretch", _validate.number("stretch", self.stretch, minimum=0.0, infinite=True))
        object.__setattr__(self, "iterations", _validate.count("iterations", self.iterations))

    @property
    def smooth(self) -> bool:
        """It moves particles once a step, by how far the step has taken them."""
        return False

    def limits(self, lattice: Lattice) -> NDArray[np.float64]:
        """Longest length in the scene's coordinates of a link of each structural family [m]."""
        longest = np.array([(1 + self.stretch) * family.length for family in lattice.families(*SIDES)])
        if lattice.dimensions == 1:
            longest *= math.sqrt(1 - (1 + self.stretch) ** -2)
        return longest

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """It moves particles after a step, and adds no force."""
        del lattice
        return LinearBound()

    def _weight(self, context: BindContext, families: tuple[Family, ...]) -> NDArray[Any]:
        """Weights of the structural links of the scene, which may break; where it has none, of links that never do."""
        for group in context.links:
            if set(SIDES) & set(group.directions):
                return group.weight
        weight = np.zeros((1, len(families), context.lattice.size), context.dtype)
        for row, family in zip(weight[0], families, strict=True):
            row[: len(family.present)] = family.present
        return weight

    def bind(self, context: BindContext) -> StrainLimitData:
        """Limits in the scene's dtype, and the lines of links that are solved at once."""
        lattice, dtype = context.lattice, context.dtype
        numbers = np.arange(lattice.size).reshape(lattice.shape)
        ends = dict(zip(SIDES, (numbers[:, :, 0].ravel(), numbers[:, 0, :].ravel()), strict=True))
        lines = [(family, ends[side]) for side in ends for family in lattice.families(side)]
        weight = self._weight(context, tuple(family for family, _ in lines))
        start = np.zeros((len(lines), max((len(first) for _, first in lines), default=0)), np.int64)
        for begin, (_, first) in zip(start, lines, strict=True):
            begin[: len(first)] = first
        links = np.array([family.present.sum() // len(first) for family, first in lines], np.int64)
        return StrainLimitData(
            np.array([family.offset for family, _ in lines], np.int64),
            self.limits(lattice).astype(dtype),
            weight,
            start,
            np.array([len(first) for _, first in lines], np.int64),
            links,
            dtype.type(0.1 * lattice.masses.min()),
            dtype.type(TOLERANCE),
            self.iterations,
            np.zeros(context.copies, np.int64),
            np.zeros((context.copies, 4, lattice.size), dtype),
        )
