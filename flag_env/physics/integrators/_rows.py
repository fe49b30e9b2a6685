"""Loops that several integrators share. Called by them alone."""

from __future__ import annotations

from flag_env.physics.compiling import kernel


@kernel
def _copy(a, b, n):
    for t in range(n):
        a[t] = b[t]


@kernel
def _add(a, b, c, n):
    for t in range(n):
        a[t] = b[t] + c[t]


@kernel
def _scale(a, factor, n):
    for t in range(n):
        a[t] *= factor


@kernel
def _add_multiple(a, b, c, factor, n):
    for t in range(n):
        a[t] = b[t] + factor * c[t]


@kernel
def _accumulate(a, b, factor, n):
    for t in range(n):
        a[t] += factor * b[t]


@kernel
def _add_row(a, b, n):
    for t in range(n):
        a[t] += b[t]


@kernel
def add_rows(a, b):
    """Add b to a, for as many rows as `a` has."""
    for d in range(a.shape[0]):
        _add_row(a[d], b[d], a.shape[1])


@kernel
def copy_rows(a, b):
    """Set a = b for as many rows as `b` has."""
    for d in range(b.shape[0]):
        _copy(a[d], b[d], b.shape[1])


@kernel
def add(a, b, c):
    """Set a = b + c, where a is neither, for as many rows as `b` has."""
    for d in range(b.shape[0]):
        _add(a[d], b[d], c[d], b.shape[1])


@kernel
def scale(a, factor):
    """Multiply a by the factor."""
    for d in range(a.shape[0]):
        _scale(a[d], factor, a.shape[1])


@kernel
def add_multiple(a, b, c, factor):
    """Set a = b + factor c, where a is neither, for as many rows as `b` has."""
    for d in range(b.shape[0]):
        _add_multiple(a[d], b[d], c[d], factor, b.shape[1])


@kernel
def accumulate(a, b, factor):
    """Add factor b to a, for as many rows as `a` has."""
    for d in range(a.shape[0]):
        _accumulate(a[d], b[d], factor, a.shape[1])
