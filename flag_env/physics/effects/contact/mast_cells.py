"""Cloth between the particles against the pole: the kernels of `MastCollision` for edges and faces of cells.

All in the pole's frame: two coordinates across it and the height above its foot. `trace` writes them for the end of the step and
for its start, which the velocities tell. In that frame the pole's axis stands still: an edge of a triangle passes it when the two
ends' cross product, a quadratic in time, has a root at which the axis lies between them; a triangle passes one of its ends when
that end changes sides. What neither edges nor ends have passed, the axis does not pierce.
"""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel

TURNS = 30
"""Most turns over all edges in a step: who is pushed may push the next."""

SHALLOW = 0.01
"""Depth, in radii, that calls for no further turn."""


@kernel
def trace(x, y, z, u, v, w, foot, across, beside, up, speed, turn, inverse, h, px, py, pz, qx, qy, qz, n):
    """Write coordinates in the pole's frame at the end of a step of `h` seconds, p, and at its start, q."""
    for t in range(n):
        dx = x[t] - foot[0]
        dy = y[t] - foot[1]
        dz = z[t] - foot[2]
        height = dx * up[0] + dy * up[1] + dz * up[2]
        share = height * inverse
        du = (u[t] - speed[0] - share * turn[0]) * h
        dv = (v[t] - speed[1] - share * turn[1]) * h
        dw = (w[t] - speed[2] - share * turn[2]) * h
        a = dx * across[0] + dy * across[1] + dz * across[2]
        b = dx * beside[0] + dy * beside[1] + dz * beside[2]
        px[t] = a
        py[t] = b
        pz[t] = height
        qx[t] = a - (du * across[0] + dv * across[1] + dw * across[2])
        qy[t] = b - (du * beside[0] + dv * beside[1] + dw * beside[2])
        qz[t] = height - (du * up[0] + dv * up[1] + dw * up[2])


@kernel
def retrace(x, y, z, foot, across, beside, up, radius, px, py, pz, qx, qy, reach, n):
    """Write the coordinates at the end of the step anew, and how far from there a particle as thick as the pole has been."""
    for t in range(n):
        dx = x[t] - foot[0]
        dy = y[t] - foot[1]
        dz = z[t] - foot[2]
        a = dx * across[0] + dy * across[1] + dz * across[2]
        b = dx * beside[0] + dy * beside[1] + dz * beside[2]
        px[t] = a
        py[t] = b
        pz[t] = dx * up[0] + dy * up[1] + dz * up[2]
        a -= qx[t]
        b -= qy[t]
        reach[t] = radius + np.sqrt(a * a + b * b)


@kernel
def _measure(x, y, z, u, v, w, foot, across, beside, speed, turn, up, inverse, radius, h, px, py, reach, n):
    """Write coordinates across the pole, and how far from there a particle as thick as the pole may have been in the step."""
    for t in range(n):
        dx = x[t] - foot[0]
        dy = y[t] - foot[1]
        dz = z[t] - foot[2]
        share = (dx * up[0] + dy * up[1] + dz * up[2]) * inverse
        du = u[t] - speed[0] - share * turn[0]
        dv = v[t] - speed[1] - share * turn[1]
        dw = w[t] - speed[2] - share * turn[2]
        px[t] = dx * across[0] + dy * across[1] + dz * across[2]
        py[t] = dx * beside[0] + dy * beside[1] + dz * beside[2]
        reach[t] = radius + h * np.sqrt(du * du + dv * dv + dw * dw)


@kernel
def _count_near(px, py, reach, pxb, pyb, reach_b, edge, n):
    """Number of edges that may have come nearer than R to the axis: |middle| < R + |e| / 2, or a.b < R^2 + R |e|."""
    near = 0
    for t in range(n):
        far = max(reach[t], reach_b[t])
        ex = pxb[t] - px[t]
        ey = pyb[t] - py[t]
        spare = px[t] * pxb[t] + py[t] * pyb[t] - far * far - far * np.sqrt(ex * ex + ey * ey)
        near += (spare <= 0) & (edge[t] != 0)
    return near


@jit
def _alive(links, cols, cell):
    """Whether all four sides of a cell are whole; `cell` is its first particle."""
    return (
        cell >= 0
        and cell + cols + 1 < links.shape[1]
        and cell % cols != cols - 1
        and links[0, cell] != 0
        and links[0, cell + cols] != 0
        and links[1, cell] != 0
        and links[1, cell + 1] != 0
    )


@jit
def _edge_alive(links, cols, family, t):
    """Whether a cell that an edge of the family belongs to is whole."""
    if family == 0:
        return _alive(links, cols, t) or _alive(links, cols, t - cols)
    if family == 1:
        return _alive(links, cols, t) or (t % cols != 0 and _alive(links, cols, t - 1))
    return _alive(links, cols, t if family == 2 else t - 1)


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
def _push(x, v, w, frame, p, corner, share, height, normal, depth, pole, bounce, friction):
    """Move three particles, by shares that make up a point of the cloth, so that it is `depth` further along `normal`.

    Its approach to the pole stops and its sliding is braked, as a particle's is.
    """
    zero = depth * 0
    one = zero + type(depth)(1)
    across, beside, up = frame
    foot_speed, turn, inverse = pole
    give = zero
    for k in range(3):
        give += w[corner[k]] * share[k] * share[k]
    if not give > 0:
        return
    u = (zero, zero, zero)
    for k in range(3):
        t = corner[k]
        u = (u[0] + share[k] * v[0, t], u[1] + share[k] * v[1, t], u[2] + share[k] * v[2, t])
    along = height * inverse
    u = (
        u[0] - foot_speed[0] - along * turn[0],
        u[1] - foot_speed[1] - along * turn[1],
        u[2] - foot_speed[2] - along * turn[2],
    )
    m = (
        normal[0] * across[0] + normal[1] * beside[0] + normal[2] * up[0],
        normal[0] * across[1] + normal[1] * beside[1] + normal[2] * up[1],
        normal[0] * across[2] + normal[1] * beside[2] + normal[2] * up[2],
    )
    change = (zero, zero, zero)
    rate = u[0] * m[0] + u[1] * m[1] + u[2] * m[2]
    if rate < 0:
        slide = (u[0] - rate * m[0], u[1] - rate * m[1], u[2] - rate * m[2])
        size = np.sqrt(slide[0] * slide[0] + slide[1] * slide[1] + slide[2] * slide[2])
        brake = min(-friction * bounce * rate / size, one) if size > 0 else zero
        change = (
            -bounce * rate * m[0] - brake * slide[0],
            -bounce * rate * m[1] - brake * slide[1],
            -bounce * rate * m[2] - brake * slide[2],
        )
    for k in range(3):
        t = corner[k]
        part = w[t] * share[k] / give
        for d in range(3):
            x[d, t] += part * depth * m[d]
            v[d, t] += part * change[d]
            p[d][t] += part * depth * normal[d]


@jit
def _treat_edges(data, links, x, v, w, frame, p, q, reach, pole, low, high):
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
            if ax * bx + ay * by > far * far + far * np.sqrt(square) or not _edge_alive(links, data.cols, family, t):
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
            _push(
                x, v, w, frame, p, (t, b, b), (one - share, share, zero), height, (nx, ny, zero), depth, pole,
                data.bounce, data.friction,
            )  # fmt: skip
            reach[t] += depth
            reach[b] += depth
            moved += depth > data.shallow * radius
    return moved


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
def _treat_ends(data, links, x, v, w, frame, p, q, reach, pole, low, high):
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
        if (most < high and least > low) or not _alive(links, cols, t):
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
                    _push(x, v, w, frame, p, (i, j, k), share, height, normal, depth, pole, data.bounce, data.friction)
                    for corner in (i, j, k):
                        reach[corner] += depth
                    moved += depth > data.shallow * radius
    return moved


@jit
def edges_near(data, x, v, foot, frame, pole, h, px, py, reach):
    """Whether an edge may have come near the axis in the step; where none has, no face and no particle has either."""
    n = x.shape[1]
    across, beside, up = frame
    speed, turn, inverse = pole
    _measure(x[0], x[1], x[2], v[0], v[1], v[2], foot, across, beside, speed, turn, up, inverse, data.radius, h, px, py, reach, n)
    for family in range(data.offset.shape[0]):
        o = data.offset[family]
        if _count_near(px, py, reach, px[o:], py[o:], reach[o:], data.edge[family], n - o):
            return True
    return False


@jit
def keep_cells_out(data, links, x, v, w, frame, p, q, reach, pole, low, high):
    """Keep edges and faces of whole cells out of the pole."""
    for _ in range(TURNS):
        moved = _treat_ends(data, links, x, v, w, frame, p, q, reach, pole, low, high)
        moved += _treat_edges(data, links, x, v, w, frame, p, q, reach, pole, low, high)
        if moved == 0:
            break
