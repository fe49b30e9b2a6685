"""Faces of cells against the ends of the pole: a triangle passes an end when that end changes sides within the triangle."""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit
from flag_env.physics.effects.contact.mast_push import is_whole, push


@jit
def _plane(a, b, c):
    """Normal of a triangle, of the length of twice its area."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@jit
def _shares(a, b, c, n, square, height):
    """Barycentric coordinates of the point (0, 0, height) in a triangle of normal n."""
    one = type(height)(1)
    e = (-a[0], -a[1], height - a[2])
    ub, uc = (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2])
    sb = (
        (e[1] * uc[2] - e[2] * uc[1]) * n[0] + (e[2] * uc[0] - e[0] * uc[2]) * n[1] + (e[0] * uc[1] - e[1] * uc[0]) * n[2]
    ) / square
    sc = (
        (ub[1] * e[2] - ub[2] * e[1]) * n[0] + (ub[2] * e[0] - ub[0] * e[2]) * n[1] + (ub[0] * e[1] - ub[1] * e[0]) * n[2]
    ) / square
    return one - sb - sc, sb, sc


@jit
def treat_ends(data, links, x, v, w, frame, p, q, reach, pole, low, high):
    """Push every triangle that one of the pole's ends has entered to the side that it came from; how many were deep."""
    radius = data.radius
    zero = radius * 0
    one = zero + type(radius)(1)
    cols = data.cols
    moved = 0
    for t in range(x.shape[1] - cols - 1):
        if data.cell[t] == 0:
            continue
        least = min(min(p[2][t], p[2][t + 1]), min(p[2][t + cols], p[2][t + cols + 1]))
        most = max(max(p[2][t], p[2][t + 1]), max(p[2][t + cols], p[2][t + cols + 1]))
        if (most < high and least > low) or not is_whole(links, cols, t):
            continue
        for end in range(2):
            height = high if end == 0 else low
            if (most < height) if end == 0 else (least > height):
                continue
            for half in range(4):  # either diagonal cuts the cell in two
                i = t if half != 0 else t + cols + 1
                j = t + 1 if half != 1 else t + cols + 1
                k = t + cols if half != 2 else t + cols + 1
                a, b, c = (p[0][i], p[1][i], p[2][i]), (p[0][j], p[1][j], p[2][j]), (p[0][k], p[1][k], p[2][k])
                n = _plane(a, b, c)
                square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
                a0, b0, c0 = (q[0][i], q[1][i], q[2][i]), (q[0][j], q[1][j], q[2][j]), (q[0][k], q[1][k], q[2][k])
                n0 = _plane(a0, b0, c0)
                square0 = n0[0] * n0[0] + n0[1] * n0[1] + n0[2] * n0[2]
                if not square > data.tiny or not square0 > data.tiny:
                    continue
                size = np.sqrt(square)
                after = (-n[0] * a[0] - n[1] * a[1] + n[2] * (height - a[2])) / size
                before = (-n0[0] * a0[0] - n0[1] * a0[1] + n0[2] * (height - a0[2])) / np.sqrt(square0)
                share = _shares(a, b, c, n, square, height)
                side = after
                if before * after < 0:  # it may have passed: through the triangle, or beside it?
                    s = before / (before - after)
                    a1 = (a0[0] + s * (a[0] - a0[0]), a0[1] + s * (a[1] - a0[1]), a0[2] + s * (a[2] - a0[2]))
                    b1 = (b0[0] + s * (b[0] - b0[0]), b0[1] + s * (b[1] - b0[1]), b0[2] + s * (b[2] - b0[2]))
                    c1 = (c0[0] + s * (c[0] - c0[0]), c0[1] + s * (c[1] - c0[1]), c0[2] + s * (c[2] - c0[2]))
                    n1 = _plane(a1, b1, c1)
                    square1 = n1[0] * n1[0] + n1[1] * n1[1] + n1[2] * n1[2]
                    if square1 > data.tiny:
                        then = _shares(a1, b1, c1, n1, square1, height)
                        if min(then[0], min(then[1], then[2])) >= 0:
                            share, side = then, before
                if not min(share[0], min(share[1], share[2])) >= 0 or side == 0:
                    continue
                sign = one if side > 0 else -one
                depth = radius - sign * after
                if depth > 0:
                    normal = (-sign * n[0] / size, -sign * n[1] / size, -sign * n[2] / size)
                    push(x, v, w, frame, p, (i, j, k), share, height, normal, depth, pole, data.bounce, data.friction)
                    for corner in (i, j, k):
                        reach[corner] += depth
                    moved += depth > data.shallow * radius
    return moved
