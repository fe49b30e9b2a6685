"""Sums over particles in float64, in four parts: an addition need not wait for the one before. The order is always the same."""

from __future__ import annotations

from flag_env.physics.compiling import kernel


@kernel
def total(a, n):
    """Sum of a."""
    p, q, r, s = 0.0, 0.0, 0.0, 0.0
    for k in range(n // 4):
        t = 4 * k
        p += a[t]
        q += a[t + 1]
        r += a[t + 2]
        s += a[t + 3]
    for t in range(n - n % 4, n):
        p += a[t]
    return (p + q) + (r + s)


@kernel
def dot(a, b, n):
    """Sum of a b."""
    p, q, r, s = 0.0, 0.0, 0.0, 0.0
    for k in range(n // 4):
        t = 4 * k
        p += a[t] * b[t]
        q += a[t + 1] * b[t + 1]
        r += a[t + 2] * b[t + 2]
        s += a[t + 3] * b[t + 3]
    for t in range(n - n % 4, n):
        p += a[t] * b[t]
    return (p + q) + (r + s)


@kernel
def weighted_dot(weight, a, b, n):
    """Sum of weight a b."""
    p, q, r, s = 0.0, 0.0, 0.0, 0.0
    for k in range(n // 4):
        t = 4 * k
        p += weight[t] * (a[t] * b[t])
        q += weight[t + 1] * (a[t + 1] * b[t + 1])
        r += weight[t + 2] * (a[t + 2] * b[t + 2])
        s += weight[t + 3] * (a[t + 3] * b[t + 3])
    for t in range(n - n % 4, n):
        p += weight[t] * (a[t] * b[t])
    return (p + q) + (r + s)
