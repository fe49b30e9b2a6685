"""Finds near pairs of a cloth's particles by blocks of 2 x 2 neighbours: less than half the work of `cells` on the particles.

A pair nearer than `reach` lies in blocks whose centres are nearer than `reach` and twice the largest radius of a block. `cells`
finds these blocks; only they are searched particle by particle. Blocks side by side always come out near, so they are left out,
and the particles in them, at most three rows and three columns apart, are tested in whole lines of the lattice, which vectorises.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects.contact.cells import find_pairs, sort_into_cells
from flag_env.physics.lattice import Lattice

SLACK = 2.0
"""Radius of a block, in its radius at rest, above which the cloth is too stretched or torn to search by blocks."""

PARTNERS = 6
"""Pairs of blocks per particle at most; more are a sign that the particles had better be searched themselves."""


class Blocks(NamedTuple):
    """Blocks of a lattice.

    Attributes
    ----------
    first : (blocks + 1,), member : (particles,)
        The particles of block b are member[first[b] : first[b + 1]].
    of : (particles,)
        The particle's block.
    code, free
        As for particles in `cells.find_pairs`: every block but the eight around one is free to meet it.
    down, right : (families,)
        Rows and columns between two particles of blocks side by side.
    cols : int
        Columns of the lattice.
    widest
        Squared radius above which blocks are no help [m^2].
    """

    first: NDArray[np.uint32]
    member: NDArray[np.uint32]
    of: NDArray[np.uint32]
    code: NDArray[np.uint32]
    free: NDArray[np.uint8]
    down: NDArray[np.int64]
    right: NDArray[np.int64]
    cols: int
    widest: Any


def codes(shape: tuple[int, int, int], near: NDArray[np.bool_]) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Number a grid so that the difference of two numbers tells whether they are neighbours of one layer.

    `near` (odd, odd) says which places around a particle, by rows and columns, are its neighbours. Rows and layers are set apart
    by a margin, so that no other difference is mistaken for one of theirs.
    """
    rows, cols = near.shape[0] // 2, near.shape[1] // 2
    width = shape[2] + 2 * cols
    layer, row, col = np.indices(shape).reshape(3, -1)
    code = (layer * (shape[1] + 2 * rows) + row) * width + col
    down, right = np.mgrid[-rows : rows + 1, -cols : cols + 1]
    span = rows * width + cols + 1
    free = np.ones(2 * span + 1, np.uint8)
    free[(span + down * width + right)[near]] = 0
    return code.astype(np.uint32), free


def blocks_of(lattice: Lattice, dtype: np.dtype[Any]) -> Blocks:
    """Cut the lattice into blocks."""
    layers, rows, cols = lattice.shape
    shape = layers, (rows + 1) // 2, (cols + 1) // 2
    layer, row, col = np.indices(lattice.shape).reshape(3, -1)
    of = (layer * shape[1] + row // 2) * shape[2] + col // 2
    code, free = codes(shape, np.ones((3, 3), bool))
    down, right = np.mgrid[0 : min(4, rows), -min(3, cols - 1) : min(4, cols)].reshape(2, -1)
    ahead = ((down > 0) | (right > 0)) & ((down > 1) | (abs(right) > 1))  # direct neighbours never collide
    along, up, _ = lattice.spacings
    return Blocks(
        first=np.searchsorted(np.sort(of), np.arange(np.prod(shape) + 1)).astype(np.uint32),
        member=np.argsort(of, kind="stable").astype(np.uint32),
        of=of.astype(np.uint32),
        code=code,
        free=free,
        down=down[ahead],
        right=right[ahead],
        cols=cols,
        widest=dtype.type((0.5 * SLACK * np.hypot(along, up)) ** 2),
    )


@kernel
def _centres(x, y, z, first, member, cx, cy, cz, blocks):
    """Write the blocks' centres; the largest squared radius, not-a-number left out."""
    widest = x.dtype.type(0)
    for b in range(blocks):
        sx = sy = sz = x.dtype.type(0)
        for k in range(first[b], first[b + 1]):
            t = member[k]
            sx += x[t]
            sy += y[t]
            sz += z[t]
        share = x.dtype.type(1) / x.dtype.type(first[b + 1] - first[b])
        sx *= share
        sy *= share
        sz *= share
        cx[b] = sx
        cy[b] = sy
        cz[b] = sz
        for k in range(first[b], first[b + 1]):
            t = member[k]
            dx = x[t] - sx
            dy = y[t] - sy
            dz = z[t] - sz
            widest = max(dx * dx + dy * dy + dz * dz, widest)
    return widest


@kernel
def _pairs_of_blocks(x, y, z, first, member, far, code, free, block, other, count, one, two, capacity):
    """Write the pairs of all listed blocks; their number, -1 where they may not fit."""
    span = free.shape[0] // 2
    found = 0
    for c in range(count):
        p, q = block[c], other[c]
        if found + (first[p + 1] - first[p]) * (first[q + 1] - first[q]) > capacity:
            return -1
        for k in range(first[p], first[p + 1]):
            a = member[k]
            for m in range(first[q], first[q + 1]):
                t = member[m]
                dx = x[t] - x[a]
                dy = y[t] - y[a]
                dz = z[t] - z[a]
                one[found] = a
                two[found] = t
                apart = np.int64(code[t]) - np.int64(code[a]) + span
                found += (dx * dx + dy * dy + dz * dz < far) & (free[min(max(apart, 0), 2 * span)] != 0)
    return found


@kernel
def _count_close(x, y, z, xb, yb, zb, far, n):
    close = 0
    for t in range(n):
        dx = xb[t] - x[t]
        dy = yb[t] - y[t]
        dz = zb[t] - z[t]
        close += dx * dx + dy * dy + dz * dz < far
    return close


@kernel
def _pairs_of_line(x, y, z, far, of, block_code, block_free, code, free, right, cols, offset, one, two, found, capacity):
    """Append the pairs (t, t + offset) of blocks side by side that are no neighbours; -1 where they may not fit."""
    block_span, span = block_free.shape[0] // 2, free.shape[0] // 2
    for t in range(x.shape[0] - offset):
        b = t + offset
        dx = x[b] - x[t]
        dy = y[b] - y[t]
        dz = z[b] - z[t]
        if not dx * dx + dy * dy + dz * dz < far or not 0 <= t % cols + right < cols:
            continue
        apart = np.int64(code[b]) - np.int64(code[t]) + span
        blocks_apart = np.int64(block_code[of[b]]) - np.int64(block_code[of[t]]) + block_span
        if free[min(max(apart, 0), 2 * span)] and not block_free[min(max(blocks_apart, 0), 2 * block_span)]:
            if found == capacity:
                return -1
            one[found] = t
            two[found] = b
            found += 1
    return found


@jit
def find_pairs_by_blocks(x, blocks, code, free, reach, start, place, order, column, pairs, effect_work):
    """As `cells.find_pairs` for the particles `x`; -1 where blocks do not suit. All from `start` on is overwritten."""
    count = blocks.first.shape[0] - 1
    if 2 * count > x.shape[1]:
        return -1
    cx, cy, cz = effect_work[0, :count], effect_work[1, :count], effect_work[2, :count]
    sx, sy, sz = effect_work[0, count:], effect_work[1, count:], effect_work[2, count:]
    widest = _centres(x[0], x[1], x[2], blocks.first, blocks.member, cx, cy, cz, count)
    if widest > blocks.widest:
        return -1
    two = x.dtype.type(2)
    wide = (reach + two * np.sqrt(widest)) * x.dtype.type(1.001)  # spare for rounding
    per_cell = x.dtype.type(0.999) / wide
    places = 4
    while places < 2 * count:
        places *= 2
    finite = sort_into_cells(cx, cy, cz, per_cell, start[: places + 1], place, order, column, sx, sy, sz, count)
    capacity = pairs.shape[1] - PARTNERS * x.shape[1]  # block pairs wait behind the room for pairs of particles
    if capacity <= 0:
        return -1
    block, other = pairs[0, capacity:], pairs[1, capacity:]
    met, searched = find_pairs(
        sx, sy, sz, per_cell, start[: places + 1], place, order, column, blocks.code, blocks.free, wide, 0, block, other, finite
    )
    if searched < finite:
        return -1
    far = reach * reach
    found = _pairs_of_blocks(
        x[0],
        x[1],
        x[2],
        blocks.first,
        blocks.member,
        far,
        code,
        free,
        block,
        other,
        met,
        pairs[0, :capacity],
        pairs[1, :capacity],
        capacity,
    )
    for j in range(blocks.down.shape[0]):
        if found < 0:
            break
        o = blocks.down[j] * blocks.cols + blocks.right[j]
        if _count_close(x[0], x[1], x[2], x[0, o:], x[1, o:], x[2, o:], far, x.shape[1] - o):
            found = _pairs_of_line(
                x[0], x[1], x[2], far, blocks.of, blocks.code, blocks.free, code, free,
                blocks.right[j], blocks.cols, o, pairs[0, :capacity], pairs[1, :capacity], found, capacity,
            )  # fmt: skip
    return found
