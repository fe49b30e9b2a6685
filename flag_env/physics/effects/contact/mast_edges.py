"""Edges of cells against the pole.

In the pole's frame its axis is the origin: an edge passes it when the cross product of its two ends, a quadratic in time, has a
root at which the axis lies between them.
"""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit
from flag_env.physics.effects.contact.mast_push import is_whole, push


@jit
def _edgeis_whole(links, cols, family, t):
    """Whether a cell that an edge of the family belongs to is whole."""
    if family == 0:
        return is_whole(links, cols, t) or is_whole(links, cols, t - cols)
    if family == 1:
        return is_whole(links, cols, t) or (t % cols != 0 and is_whole(links, cols, t - 1))
    return is_whole(links, cols, t if family == 2 else t - 1)


@jit
def _passes(ax, ay, bx, by, da, db, dc, dd):
    """First time in [0, 1] at which the edge (a + s (da, db), b + s (dc, dd)) has the origin between its ends; -1 if never."""
    zero = ax * 0
    one = zero + type(ax)(1)
    two = one + one
    c0 = ax * by - ay * bx
    c1 = ax * dd - ay * dc + da * by - db * bx
    c2 = da * dd - db * dc
    inside = c1 * c1 - two * two * c0 * c2
    if not inside >= 0:
        return -one
    q = c1 + np.sqrt(inside) if c1 > 0 else c1 - np.sqrt(inside)
    first = -two * c0 / q if q != 0 else two
    second = -q / (two * c2) if c2 != 0 else two
    for s in (min(first, second), max(first, second)):
        if zero <= s <= one and (ax + s * da) * (bx + s * dc) + (ay + s * db) * (by + s * dd) <= 0:
            return s
    return -one


@jit
def treat_edges(data, links, x, v, w, frame, p, q, reach, pole, low, high):
    """Push every edge that has entered the pole to the side that it came from; how many were deep in it."""
    radius = data.radius
    zero = radius * 0
    one = zero + type(radius)(1)
    moved = 0
    for family in range(data.offset.shape[0]):
        o = data.offset[family]
        for t in range(x.shape[1] - o):
            b = t + o
            if data.edge[family, t] == 0:
                continue
            ax, ay, bx, by = p[0][t], p[1][t], p[0][b], p[1][b]
            ex, ey = bx - ax, by - ay
            far = max(reach[t], reach[b])
            square = ex * ex + ey * ey
            if ax * bx + ay * by > far * far + far * np.sqrt(square) or not _edgeis_whole(links, data.cols, family, t):
                continue
            da, db, dc, dd = ax - q[0][t], ay - q[1][t], bx - q[0][b], by - q[1][b]
            s = _passes(q[0][t], q[1][t], q[0][b], q[1][b], da, db, dc, dd)
            if s >= 0:
                cx, cy = q[0][t] + s * da, q[1][t] + s * db
                ex, ey = q[0][b] + s * dc - cx, q[1][b] + s * dd - cy
                square = ex * ex + ey * ey
                share = min(max(-(cx * ex + cy * ey) / square, zero), one) if square > data.tiny else zero
                size = np.sqrt(square)
                gx, gy = (one - share) * ax + share * bx, (one - share) * ay + share * by
                motion = (one - share) * (da * -ey + db * ex) + share * (dc * -ey + dd * ex)
                if not size > 0 or motion == 0:
                    continue
                sign = -one if motion > 0 else one
                nx, ny = -sign * ey / size, sign * ex / size
            else:
                share = min(max(-(ax * ex + ay * ey) / square, zero), one) if square > data.tiny else zero
                gx, gy = ax + share * ex, ay + share * ey
                size = np.sqrt(gx * gx + gy * gy)
                if not size < radius or not size > 0:
                    continue
                nx, ny = gx / size, gy / size
            height = (one - share) * p[2][t] + share * p[2][b]
            depth = radius - (gx * nx + gy * ny)
            if not low <= height <= high or not depth > 0:
                continue
            push(
                x, v, w, frame, p, (t, b, b), (one - share, share, zero), height, (nx, ny, zero), depth, pole,
                data.bounce, data.friction,
            )  # fmt: skip
            reach[t] += depth
            reach[b] += depth
            moved += depth > data.shallow * radius
    return moved
