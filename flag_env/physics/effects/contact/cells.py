"""Finds all pairs of particles near each other in a time linear in their number: a hashed grid and a counting sort.

Space is cut into cubes at least as wide as the search reaches, so that partners stand in the same cube or in one of the 26
around it. A column of cubes (along the last coordinate) hashes to a place in a table and its cubes follow one another there: the
three cubes of a column that a particle looks into are one run of the sorted particles, and half of the columns are enough to
meet every pair once. Columns that share a place are told apart by their number. Source: Teschner et al., Optimized Spatial
Hashing for Collision Detection of Deformable Objects, VMV 2003.
"""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel

OUTERMOST = 1 << 20
"""Cells from the origin beyond which all is one cell: keeps the numbers of cells finite and unique."""


def table_size(particles: int) -> int:
    """Places in the hash table: a power of two, at least twice the particles and more than the three of one look."""
    return int(max(4, 1 << (2 * particles - 1).bit_length()))


@jit
def _cell(value, per_cell):
    """Number of the cell; non-decreasing in `value`, and in double precision, so that rounding moves no partner two cells off."""
    return np.int64(max(min(np.floor(np.float64(value) * per_cell), OUTERMOST), -OUTERMOST))


@jit
def _place(i, j):
    """Hash of column (i, j)."""
    return (i * 73856093) ^ (j * 19349663)


@kernel
def sort_into_cells(x, y, z, per_cell, start, place, order, column, sx, sy, sz, n):
    """Sort the particles by cell; the number sorted: those at positions that are not finite are left out.

    Written: `start` (table_size + 1), where each place begins; `place` (n), each particle's, or the table's size; and in sorted
    order the particles, `order`, the numbers of their columns, `column`, and their positions, `sx, sy, sz`.
    """
    size = start.shape[0] - 1
    for b in range(size + 1):
        start[b] = 0
    for t in range(n):
        if (x[t] - x[t]) + (y[t] - y[t]) + (z[t] - z[t]) != 0:  # not finite
            place[t] = size
            continue
        b = (_place(_cell(x[t], per_cell), _cell(y[t], per_cell)) + _cell(z[t], per_cell)) & (size - 1)
        place[t] = b
        start[b] += 1
    total = start[0]
    for b in range(1, size + 1):
        total += start[b]
        start[b] = total  # the end of place b, until it is filled from behind
    for t in range(n - 1, -1, -1):
        b = place[t]
        if b == size:
            continue
        start[b] -= 1
        p = start[b]
        order[p] = t
        column[p] = _cell(x[t], per_cell) * (4 * OUTERMOST) + _cell(y[t], per_cell)
        sx[p] = x[t]
        sy[p] = y[t]
        sz[p] = z[t]
    return total


@kernel
def find_pairs(sx, sy, sz, per_cell, start, partner, order, column, code, free, reach, p, one, two, n):
    """Write pairs nearer than `reach` to `one`, `two`: those of the sorted particles from `p` on, as many particles as fit.

    Left out are the pairs whose codes differ by a number for which `free` (odd length, from the middle) says so. Takes what
    `sort_into_cells` wrote, with cells wider than `reach`; `partner` (particles + 1) is overwritten. Returns the number of pairs
    and the sorted particle to go on from: `n` when all have been found. Arrays as long as there are particles get on by one
    particle at least, and those with a place for any two particles are never too short.

    Candidates are written first and counted after: a branch on a coin toss would cost more than the test.
    """
    size = start.shape[0] - 1
    capacity = one.shape[0]
    span = free.shape[0] // 2
    far = reach * reach
    found = 0
    full = False
    while p < n and not full:  # the particles p <= q < past stand in one cell
        own = column[p]
        i, j, k = _cell(sx[p], per_cell), _cell(sy[p], per_cell), _cell(sz[p], per_cell)
        past = p + 1
        while past < n and column[past] == own and _cell(sz[past], per_cell) == k:
            past += 1
        m = 0
        for c in range(5):  # columns (0, 0), (0, 1), (1, -1), (1, 0), (1, 1)
            di = 0 if c < 2 else 1
            dj = c if c < 2 else c - 3
            wanted = own + di * (4 * OUTERMOST) + dj
            below = 0 if c == 0 else 1  # in its own column a particle looks at those after it only
            b = (_place(i + di, j + dj) + k - below) & (size - 1)
            end = b + below + 2
            q, last = (p if c == 0 else start[b]), start[min(end, size)]
            while True:
                while q < last:
                    partner[m] = q
                    m += column[q] == wanted
                    q += 1
                if end <= size:
                    break
                q, last, end = 0, start[end - size], 0  # the run goes on at the table's front
        first = found
        for o in range(p, past):
            ahead = o - p + 1
            if found + m - ahead > capacity:
                full, past = True, o
                break
            a = order[o]
            x, y, z = sx[o], sy[o], sz[o]
            for s in range(ahead, m):
                q = partner[s]
                dx = sx[q] - x
                dy = sy[q] - y
                dz = sz[q] - z
                one[found] = a
                two[found] = order[q]
                found += dx * dx + dy * dy + dz * dz < far
        candidates = found
        found = first
        for s in range(first, candidates):
            a, t = one[s], two[s]
            one[found] = a
            two[found] = t
            apart = np.int64(code[t]) - np.int64(code[a]) + span
            found += int(np.int64(free[min(max(apart, 0), 2 * span)]))
        p = past
    return found, p


@kernel
def count_moved(x, y, z, ax, ay, az, limit, n):
    """Number of particles farther than the root of `limit` from (ax, ay, az), not-a-number included."""
    moved = 0
    for t in range(n):
        dx = x[t] - ax[t]
        dy = y[t] - ay[t]
        dz = z[t] - az[t]
        moved += not (dx * dx + dy * dy + dz * dz <= limit)
    return moved


@kernel
def count_different(a, b, n):
    """Number of entries that differ."""
    different = 0
    for t in range(n):
        different += a[t] != b[t]
    return different


@kernel
def copy_into(a, b, n):
    """Copy `b` to `a`."""
    for t in range(n):
        a[t] = b[t]
