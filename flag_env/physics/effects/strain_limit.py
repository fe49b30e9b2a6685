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
elements (folds) keeps 2 T - J W J' semi-definite, so that no turn moves the pose away from any admissible one. Rows and columns
take turns until no link is longer than L (1 + TOLERANCE), at most `iterations` times.

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

from flag_env.physics import validate
from flag_env.physics.effects.base import Effect, Setting
from flag_env.physics.effects.structural import Structural
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Lattice

TOLERANCE = 1e-3
"""Excess over the longest length, relative to it, that is left."""

SHIFTS = (1e-5, 1e-2, 1.0)
"""Relative growth of the system's diagonal. The first keeps it regular where both ends of a line are pinned; the others tame the
pulls, else of any size, where the mast makes the limit impossible."""


@kernel
def _add_square(out, p, q, pb, qb, lag, n):
    for t in range(n):
        e = (pb[t] - p[t]) - lag * (qb[t] - q[t])
        out[t] += e * e


@kernel
def _count(square, weight, w, wb, most, n):
    over = 0
    for t in range(n):
        over += (square[t] > most) & (weight[t] != 0) & (w[t] + wb[t] > 0)
    return over


@kernel
def _lengths(square, share, weight, w, wb, limit, zero, one, n):
    """Turn squared lengths into excess lengths, minus infinity where nothing is limited, and inverse lengths."""
    for t in range(n):
        length = np.sqrt(square[t])
        limited = (weight[t] != 0) & (w[t] + wb[t] > 0)
        share[t] = one / length if length > 0 else zero
        square[t] = length - limit if limited else -np.inf


@kernel
def _direct(normal, p, q, pb, qb, lag, share, n):
    for t in range(n):
        normal[t] = ((pb[t] - p[t]) - lag * (qb[t] - q[t])) * share[t]


@kernel
def _add_product(out, a, b, n):
    for t in range(n):
        out[t] += a[t] * b[t]


@kernel
def _weigh(coupling, w, zero, n):
    for t in range(n):
        coupling[t] = w[t] * max(zero, coupling[t])


@kernel
def _fill(a, value, n):
    for t in range(n):
        a[t] = value


@kernel
def _move(p, q, pull, normal, w, sign, rate, n):
    for t in range(n):
        move = sign * w[t] * pull[t] * normal[t]
        p[t] += move
        q[t] += rate * move


@jit
def _squares(x, v, lag, offset, out):
    """Squared lengths of a family's links, `lag` seconds ago."""
    n = x.shape[1] - offset
    _fill(out, x.dtype.type(0), n)
    for d in range(x.shape[0]):
        _add_square(out, x[d], v[d], x[d, offset:], v[d, offset:], lag, n)


@kernel
def _solve(excess, coupling, pivot, pull, w, start, stride, links, least, zero, one, grown):
    """Pulls on one line's links, none of them negative, unless all excess together is no more than `least`; the largest."""
    total = zero
    for i in range(links):
        total += max(zero, excess[start + i * stride])
    if not total > least:
        return zero
    inert = -total  # slack by more than all the others' excess
    dropped = True
    while dropped:
        pivot_before, before, y = zero, zero, zero
        for i in range(links):
            t = start + i * stride
            c = excess[t]
            active = c > inert
            off = before if active else zero
            carried = off * pivot_before
            y = c + carried * y if active else zero
            pivot_before = one / ((w[t] + w[t + stride]) * grown - off * carried) if active else zero
            pivot[t] = pivot_before
            pull[t] = y
            before = coupling[t] if active else zero
        after, largest = zero, zero
        dropped = False
        for i in range(links - 1, -1, -1):
            t = start + i * stride
            after = (pull[t] + coupling[t] * after) * pivot[t]
            pull[t] = after
            if after < 0 and excess[t] < 0:
                dropped = True
                excess[t] = -np.inf
                after = zero
            largest = max(largest, after)
    return largest


@jit
def _lengthens(x, v, lag, weight, inverse_mass, pull, normal, start, stride, links, limit):
    """Whether the pulls make a line longer: the system knows nothing of the turning of links."""
    zero = x.dtype.type(0)
    more = zero
    for i in range(links):
        t = start + i * stride
        u = t + stride
        before, after = zero, zero
        for d in range(x.shape[0]):
            here, behind, ahead = pull[t] * normal[d, t], zero, zero
            if i > 0:
                behind = pull[t - stride] * normal[d, t - stride]
            if i + 1 < links:
                ahead = pull[u] * normal[d, u]
            e = (x[d, u] - x[d, t]) - lag * (v[d, u] - v[d, t])
            before += e * e
            e += inverse_mass[u] * (ahead - here) - inverse_mass[t] * (here - behind)
            after += e * e
        if weight[t] != 0 and inverse_mass[t] + inverse_mass[u] > 0:
            more += max(zero, np.sqrt(after) - limit) - max(zero, np.sqrt(before) - limit)
    return more > 0


@jit
def _shorten(bound, j, work, x, v, lag, rate, weight, scratch, inverse_mass, slack):
    """Pull the lines of one family to its limit if a link exceeds it by more than it times `slack`; whether that was so."""
    offset, limit = bound.offset[j], bound.limit[j]
    n = x.shape[1] - offset
    excess, coupling, pivot, pull = work[0], work[1], work[2], work[3]
    w, wb = inverse_mass, inverse_mass[offset:]
    number = x.dtype.type
    zero, one, least = number(0), number(1), number(0.5) * limit * slack
    _squares(x, v, lag, offset, excess)
    longest = limit + limit * slack
    if _count(excess, weight, w, wb, longest * longest, n) == 0:
        return False
    _lengths(excess, pull, weight, w, wb, limit, zero, one, n)
    _fill(coupling, zero, x.shape[1])
    for d in range(x.shape[0]):
        _direct(scratch[d], x[d], v[d], x[d, offset:], v[d, offset:], lag, pull, n)
        _add_product(coupling, scratch[d], scratch[d, offset:], n - offset)
    _weigh(coupling, wb, zero, n)
    _fill(pull, zero, n)
    start, links = bound.start[j], bound.links[j]
    for i in range(bound.lines[j]):
        for shift in SHIFTS:
            largest = _solve(excess, coupling, pivot, pull, w, start[i], offset, links, least, zero, one, number(1 + shift))
            if not largest > bound.large * limit or not _lengthens(
                x, v, lag, weight, inverse_mass, pull, scratch, start[i], offset, links, limit
            ):
                break
    for d in range(x.shape[0]):
        _move(x[d], v[d], pull, scratch[d], w, one, rate, n)
        _move(x[d, offset:], v[d, offset:], pull, scratch[d], wb, -one, rate, n)
    return True


class BoundStrainLimit(NamedTuple):
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
        Most turns of rows and columns.
    work : (copies, 4, particles)
        Room for the links of one family.
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
    work: NDArray[Any]

    @staticmethod
    @jit
    def project(bound, copy, x, v, scratch, inverse_mass, seconds):
        """Shorten what was too long before the step, without a change of velocity, then what the step made too long.

        Of the latter every excess at first, then what is beyond the tolerance; rows and columns in turn.
        """
        number = x.dtype.type
        weight = bound.weight[copy % bound.weight.shape[0]]
        lag, rate, slack = number(seconds), number(0), bound.tolerance
        for _ in range(2):
            for _ in range(bound.iterations):
                busy = False
                for j in range(bound.offset.shape[0]):
                    if _shorten(bound, j, bound.work[copy], x, v, lag, rate, weight[j], scratch, inverse_mass, slack):
                        busy = True
                if not busy:
                    break
                slack = bound.tolerance
            lag, rate, slack = number(0), number(1 / seconds), number(0)


@dataclass(frozen=True)
class StrainLimit(Effect):
    """A longest length for every structural link, kept after each step.

    Parameters
    ----------
    stretch
        Largest strain s of a link, >= 0.
    iterations
        Most turns of rows and columns in a step; it stops as soon as the limit holds to one part in a thousand.
    """

    stretch: float = 0.1
    iterations: int = 30

    def __post_init__(self) -> None:
        object.__setattr__(self, "stretch", validate.number("stretch", self.stretch, minimum=0.0))
        object.__setattr__(self, "iterations", validate.count("iterations", self.iterations))

    def limits(self, lattice: Lattice) -> NDArray[np.float64]:
        """Longest length in the scene's coordinates of a link of each structural family [m]."""
        longest = np.array([(1 + self.stretch) * family.length for family in lattice.families(*Structural.steps)])
        if lattice.dimensions == 1:
            longest *= math.sqrt(1 - (1 + self.stretch) ** -2)
        return longest

    def bind(self, setting: Setting) -> BoundStrainLimit:
        """Limits in the scene's dtype, and the lines of links that are solved at once."""
        lattice, dtype = setting.lattice, setting.dtype
        numbers = np.arange(lattice.size).reshape(lattice.shape)
        ends = {(0, 0, 1): numbers[:, :, 0].ravel(), (0, 1, 0): numbers[:, 0, :].ravel()}
        lines = [(family, ends[step]) for step in Structural.steps for family in lattice.families(step)]
        weight = np.zeros((1, len(lines), lattice.size), dtype)
        start = np.zeros((len(lines), max((len(first) for _, first in lines), default=0)), np.int64)
        for row, begin, (family, first) in zip(weight[0], start, lines, strict=True):
            row[: len(family.present)] = family.present
            begin[: len(first)] = first
        links = np.array([family.present.sum() // len(first) for family, first in lines], np.int64)
        return BoundStrainLimit(
            np.array([family.offset for family, _ in lines], np.int64),
            self.limits(lattice).astype(dtype),
            weight,
            start,
            np.array([len(first) for _, first in lines], np.int64),
            links,
            dtype.type(0.1 * lattice.masses.min()),
            dtype.type(TOLERANCE),
            self.iterations,
            np.zeros((setting.copies, 4, lattice.size), dtype),
        )
