"""Lines of links, solved at once: the kernels of `StrainLimit`, which tells their formulas."""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel

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
def holds(data, x, v, weight, inverse_mass, work):
    """Whether no link is longer than its limit and the tolerance allow."""
    zero = x.dtype.type(0)
    for j in range(data.offset.shape[0]):
        offset, longest = data.offset[j], data.limit[j] + data.limit[j] * data.tolerance
        _squares(x, v, zero, offset, work[0])
        if _count(work[0], weight[j], inverse_mass, inverse_mass[offset:], longest * longest, x.shape[1] - offset):
            return False
    return True


@jit
def shorten(data, j, work, x, v, lag, rate, weight, effect_work, inverse_mass, slack):
    """Pull the lines of one family to its limit if a link exceeds it by more than it times `slack`; whether that was so."""
    offset, limit = data.offset[j], data.limit[j]
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
        _direct(effect_work[d], x[d], v[d], x[d, offset:], v[d, offset:], lag, pull, n)
        _add_product(coupling, effect_work[d], effect_work[d, offset:], n - offset)
    _weigh(coupling, wb, zero, n)
    _fill(pull, zero, n)
    start, links = data.start[j], data.links[j]
    for i in range(data.lines[j]):
        for shift in SHIFTS:
            largest = _solve(excess, coupling, pivot, pull, w, start[i], offset, links, least, zero, one, number(1 + shift))
            if not largest > data.large * limit or not _lengthens(
                x, v, lag, weight, inverse_mass, pull, effect_work, start[i], offset, links, limit
            ):
                break
    for d in range(x.shape[0]):
        _move(x[d], v[d], pull, effect_work[d], w, one, rate, n)
        _move(x[d, offset:], v[d, offset:], pull, effect_work[d], wb, -one, rate, n)
    return True
