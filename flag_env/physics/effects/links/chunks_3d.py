"""Compiled link forces in three coordinates; the formulas stand in `link_effect`.

In chunks of sixteen particles: the forces on the first particles of a family's links go to scratch, and at once into the sums of
the chunk, with those on second particles, which an earlier chunk or this one has found. So nothing that belongs to a force leaves
the nearest cache. The end, where a family has no links any more, is done without chunks of sums; the links' last chunk is moved
back to where they end, and finds some forces anew, the same. In float32 two families share a pass; in float64 the processor's
registers do not hold two. Scratch serves one block of particles after the other, so that of a large flag it stays in a cache too.
Kernels take whole rows and where to begin in them: to cut a slice takes compiled code as long as some particles do.
"""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import inlined, jit, kernel
from flag_env.physics.effects.links.kernels import add_family, near

CHUNK = 16
"""Particles from a force to its sum. LLVM turns a loop of this fixed length into vectors and nothing else, with no test of where
arrays overlap or end; a shorter one it unrolls before it can."""

WIDE = np.uint64(CHUNK)
"""`CHUNK` for index arithmetic: for unsigned numbers Numba emits no test of the sign."""

BLOCK = 4096
"""Particles that scratch serves at a time, or as many as the second particles are away."""


def _pull(data, dx, dy, dz, du, dv, dw, weight, tension):
    """Force of a link of this weight on its first particle, from the differences of its ends' positions and velocities."""
    return data.pull(data, dx, dy, dz, du, dv, dw, weight, tension)


@inlined(_pull)
def _compile_pull(data, dx, dy, dz, du, dv, dw, weight, tension):
    return data.instance_class.pull


@kernel
def link(data, x, y, z, u, v, w, i, j, weight, tension):
    """Force on particle i of the link from it to particle j of a family."""
    return _pull(data, x[j] - x[i], y[j] - y[i], z[j] - z[i], u[j] - u[i], v[j] - v[i], w[j] - w[i], weight[i], tension)


@kernel
def _one(data, x, y, z, u, v, w, weight, tension, gx, gy, gz, offset, fx, fy, fz, base, chunks):
    """Forces of one family, and their sums, in chunks from particle `base` on, which scratch begins with."""
    for chunk in range(chunks):
        start = np.uint64(chunk) * WIDE
        for t in range(CHUNK):
            own = start + np.uint64(t) + offset
            i = base + start + np.uint64(t)
            j = i + offset
            gx[own], gy[own], gz[own] = link(data, x, y, z, u, v, w, i, j, weight, tension)
        for t in range(CHUNK):
            far = start + np.uint64(t)
            own = far + offset
            i = base + far
            fx[i] = fx[i] + gx[own] - gx[far]
            fy[i] = fy[i] + gy[own] - gy[far]
            fz[i] = fz[i] + gz[own] - gz[far]


@kernel
def _two(
    data, x, y, z, u, v, w, weight_a, weight_b, tension_a, tension_b,
    ax, ay, az, bx, by, bz, offset_a, offset_b, fx, fy, fz, base, chunks,
):  # fmt: skip
    """Forces of two families, and their sums, in chunks from particle `base` on, which scratch begins with."""
    for chunk in range(chunks):
        start = np.uint64(chunk) * WIDE
        for t in range(CHUNK):
            own_a = start + np.uint64(t) + offset_a
            own_b = start + np.uint64(t) + offset_b
            i = base + start + np.uint64(t)
            j = i + offset_a
            ax[own_a], ay[own_a], az[own_a] = link(data, x, y, z, u, v, w, i, j, weight_a, tension_a)
            j = i + offset_b
            bx[own_b], by[own_b], bz[own_b] = link(data, x, y, z, u, v, w, i, j, weight_b, tension_b)
        for t in range(CHUNK):
            far = start + np.uint64(t)
            own_a = far + offset_a
            own_b = far + offset_b
            i = base + far
            fx[i] = fx[i] + ax[own_a] - ax[far] + bx[own_b] - bx[far]
            fy[i] = fy[i] + ay[own_a] - ay[far] + by[own_b] - by[far]
            fz[i] = fz[i] + az[own_a] - az[far] + bz[own_b] - bz[far]


@kernel
def rest(data, x, y, z, u, v, w, weight, tension, gx, gy, gz, offset, base, start, stop):
    """Forces alone of one family's links that begin from `start` to before `stop`, counted from `base`."""
    if stop < CHUNK:
        for t in range(start, stop):
            own = np.uint64(t) + offset
            i = base + np.uint64(t)
            j = i + offset
            gx[own], gy[own], gz[own] = link(data, x, y, z, u, v, w, i, j, weight, tension)
        return
    for chunk in range(start, stop, CHUNK):
        moved = np.uint64(min(chunk, stop - CHUNK))
        for t in range(CHUNK):
            own = moved + np.uint64(t) + offset
            i = base + moved + np.uint64(t)
            j = i + offset
            gx[own], gy[own], gz[own] = link(data, x, y, z, u, v, w, i, j, weight, tension)


@kernel
def sum_one(fx, fy, fz, gx, gy, gz, offset, base, start, n):
    """Sums alone of one family's forces, from particle `start` to before `n`, counted from `base`."""
    for t in range(start, n):
        far = np.uint64(t)
        own = far + offset
        i = base + far
        fx[i] = fx[i] + gx[own] - gx[far]
        fy[i] = fy[i] + gy[own] - gy[far]
        fz[i] = fz[i] + gz[own] - gz[far]


@kernel
def _sum_two(fx, fy, fz, ax, ay, az, bx, by, bz, offset_a, offset_b, base, start, n):
    for t in range(start, n):
        far = np.uint64(t)
        own_a = far + offset_a
        own_b = far + offset_b
        i = base + far
        fx[i] = fx[i] + ax[own_a] - ax[far] + bx[own_b] - bx[far]
        fy[i] = fy[i] + ay[own_a] - ay[far] + by[own_b] - by[far]
        fz[i] = fz[i] + az[own_a] - az[far] + bz[own_b] - bz[far]


@kernel
def clear(gx, gy, gz, start, n):
    """Clear n entries from `start` on."""
    for t in range(n):
        i = start + np.uint64(t)
        gx[i] = 0
        gy[i] = 0
        gz[i] = 0


@kernel
def _carry(g, end, n):
    for t in range(n):
        g[t] = end[t]


@jit
def forces_3d(data, copy, x, v, f, g, lag):
    """Forces of every family, `g` being scratch: rows 0 to 2 for a family, 3 to 5 for another."""
    weights, tension, offset = data.weight[copy % data.weight.shape[0]], data.tension, data.offset
    n, first = x.shape[1], 0
    while first < offset.shape[0]:
        o = offset[first]
        closely = near(o, n)
        two = closely and x.itemsize == 4 and first + 1 < offset.shape[0] and near(offset[first + 1], n)
        p = offset[first + 1] if two else o
        to_a, to_b = np.uint64(o), np.uint64(p)
        base, chunks = 0, 0
        if closely:
            clear(g[0], g[1], g[2], np.uint64(0), o)
            if two:
                clear(g[3], g[4], g[5], np.uint64(0), p)
            reach = max(o, p)
            block = max(BLOCK, (reach // CHUNK + 1) * CHUNK)
            while True:
                last = n - reach - base < block
                chunks = ((n - reach - base) if last else block) // CHUNK
                if two:
                    _two(
                        data, x[0], x[1], x[2], v[0], v[1], v[2],
                        weights[first], weights[first + 1], tension[first], tension[first + 1],
                        g[0], g[1], g[2], g[3], g[4], g[5], to_a, to_b, f[0], f[1], f[2], np.uint64(base), chunks,
                    )  # fmt: skip
                else:
                    _one(
                        data, x[0], x[1], x[2], v[0], v[1], v[2], weights[first], tension[first],
                        g[0], g[1], g[2], to_a, f[0], f[1], f[2], np.uint64(base), chunks,
                    )  # fmt: skip
                if last:
                    break
                for d in range(3):
                    _carry(g[d], g[d, block:], o)
                    if two:
                        _carry(g[d + 3], g[d + 3, block:], p)
                base += block
            clear(g[0], g[1], g[2], np.uint64(n - base), o)
            if two:
                clear(g[3], g[4], g[5], np.uint64(n - base), p)
        start, left, at = chunks * CHUNK, n - base, np.uint64(base)
        rest(
            data, x[0], x[1], x[2], v[0], v[1], v[2], weights[first], tension[first], g[0], g[1], g[2], to_a, at, start, left - o
        )  # fmt: skip
        if two:
            rest(
                data, x[0], x[1], x[2], v[0], v[1], v[2], weights[first + 1], tension[first + 1],
                g[3], g[4], g[5], to_b, at, start, left - p,
            )  # fmt: skip
            _sum_two(f[0], f[1], f[2], g[0], g[1], g[2], g[3], g[4], g[5], to_a, to_b, at, start, left)
        elif closely:
            sum_one(f[0], f[1], f[2], g[0], g[1], g[2], to_a, at, start, left)
        else:
            add_family(f, g, o)
        first += 2 if two else 1
