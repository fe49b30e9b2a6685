"""Contact of pairs of particles, and the lists of pairs: the kernels of `SelfCollision`, which tells their formulas."""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel
from flag_env.physics.effects.contact.blocks import find_pairs_by_blocks
from flag_env.physics.effects.contact.cells import copy_into, find_pairs, sort_into_cells


@kernel
def _separate(x, y, z, u, v, w, one, two, count, inverse_mass, rx, ry, rz, thickness, share, bounce, friction, tiny):
    """Push apart the pairs that are too near, stop their approach and brake their sliding."""
    zero = x.dtype.type(0)
    near = thickness * thickness
    for c in range(count):
        i, j = one[c], two[c]
        dx = x[j] - x[i]
        dy = y[j] - y[i]
        dz = z[j] - z[i]
        d2 = dx * dx + dy * dy + dz * dz
        if not d2 < near:
            continue
        lx = rx[j] - rx[i]
        ly = ry[j] - ry[i]
        lz = rz[j] - rz[i]
        reach = min(thickness, share * np.sqrt(lx * lx + ly * ly + lz * lz))
        d = np.sqrt(d2)
        wi, wj = inverse_mass[i], inverse_mass[j]
        total = wi + wj
        if not d < reach or total == 0:
            continue
        if d2 > tiny:
            dx /= d
            dy /= d
            dz /= d
        else:
            d, dx, dy, dz = zero, zero, zero + x.dtype.type(1), zero
        push = (reach - d) / total
        x[i] -= wi * push * dx
        y[i] -= wi * push * dy
        z[i] -= wi * push * dz
        x[j] += wj * push * dx
        y[j] += wj * push * dy
        z[j] += wj * push * dz
        du = u[j] - u[i]
        dv = v[j] - v[i]
        dw = w[j] - w[i]
        rate = du * dx + dv * dy + dw * dz
        if not rate < 0:
            continue
        impulse = -bounce * rate / total
        du -= rate * dx
        dv -= rate * dy
        dw -= rate * dz
        slide = np.sqrt(du * du + dv * dv + dw * dw)
        brake = zero
        if slide > 0:
            brake = min(friction * impulse, slide / total) / slide
        px = impulse * dx - brake * du
        py = impulse * dy - brake * dv
        pz = impulse * dz - brake * dw
        u[i] -= wi * px
        v[i] -= wi * py
        w[i] -= wi * pz
        u[j] += wj * px
        v[j] += wj * py
        w[j] += wj * pz


@jit
def _treat(data, copy, x, v, inverse_mass, count):
    """Treat the first `count` pairs in a copy's arrays."""
    _separate(
        x[0], x[1], x[2], v[0], v[1], v[2], data.pairs[copy, 0], data.pairs[copy, 1], count, inverse_mass,
        data.rest[0], data.rest[1], data.rest[2], data.thickness, data.share, data.bounce, data.friction, data.tiny,
    )  # fmt: skip


@jit
def _sort(data, copy, effect_work):
    """Sort the particles as the list is to be of into cells, in `effect_work`; their number."""
    x = data.listed[copy]
    return sort_into_cells(
        x[0], x[1], x[2], data.per_cell, data.start[copy], data.place[copy], data.order[copy], data.column[copy],
        effect_work[0], effect_work[1], effect_work[2], x.shape[1],
    )  # fmt: skip


@jit
def _find(data, copy, effect_work, first, finite):
    """Write pairs of the sorted particles from `first` on to the copy's arrays, as many as fit."""
    return find_pairs(
        effect_work[0], effect_work[1], effect_work[2], data.per_cell, data.start[copy], data.place[copy], data.order[copy],
        data.column[copy], data.code, data.free, data.reach, first, data.pairs[copy, 0], data.pairs[copy, 1], finite,
    )  # fmt: skip


@jit
def make_list(data, copy, effect_work):
    """List the pairs of the reference positions; where they do not all fit, the list's length is -1."""
    n = data.rest.shape[1]
    listed = data.listed[copy]
    for d in range(3):
        copy_into(listed[d], data.reference[copy, d], n)
    count = find_pairs_by_blocks(
        listed, data.blocks, data.code, data.free, data.reach,
        data.start[copy], data.place[copy], data.order[copy], data.column[copy], data.pairs[copy], effect_work,
    )  # fmt: skip
    if count < 0:
        finite = _sort(data, copy, effect_work)
        count, searched = _find(data, copy, effect_work, 0, finite)
        if searched < finite:
            count = -1
    data.listed_pairs[copy] = count


@jit
def treat_pairs(data, copy, x, v, effect_work, inverse_mass):
    """Treat every near pair once: those of the list, or where they do not all fit, as many at a time as do.

    Their order is the same both ways, and with it every bit.
    """
    count = data.listed_pairs[copy]
    if count >= 0:
        _treat(data, copy, x, v, inverse_mass, count)
        return
    finite = _sort(data, copy, effect_work)
    first = 0
    while first < finite:
        count, first = _find(data, copy, effect_work, first, finite)
        _treat(data, copy, x, v, inverse_mass, count)
