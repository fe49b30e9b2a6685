"""Solves a constant, symmetric, positive definite sparse system for three coordinates at once, without allocating.

The unknowns are reordered for a narrow band (reverse Cuthill-McKee: about twice the shorter side of a cloth with bending links),
and A = L L' is factorised once. L is kept by columns for the forward pass and by rows for the backward pass, so that both inner
loops run over contiguous numbers and serve three coordinates for one reading of L.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse
from numba import uint64
from numpy.typing import NDArray
from scipy.sparse.csgraph import reverse_cuthill_mckee

from flag_env.physics.compiling import jit, kernel
from flag_env.physics.integrators.base import Spectrum


class Factor(NamedTuple):
    """Cholesky factor of a mass-scaled matrix I + p Z + q K.

    Attributes
    ----------
    order : (unknowns,)
        Flat particle number of each unknown.
    scale : (unknowns,)
        1 / sqrt(mass) [kg^-1/2].
    inverse_pivot : (unknowns,)
        1 / L_jj.
    columns : (unknowns, band)
        L_{j+1+i, j}.
    rows : (unknowns, band)
        L_{j, j-band+i}.
    """

    order: NDArray[np.intp]
    scale: NDArray[Any]
    inverse_pivot: NDArray[Any]
    columns: NDArray[Any]
    rows: NDArray[Any]


def factorise(spectrum: Spectrum, dtype: np.dtype[Any], damping: float, stiffness: float) -> Factor:
    """Factor of I + damping Z + stiffness K, mass-scaled."""
    size = len(spectrum.free)
    order, entries, band = _reordered(spectrum, damping, stiffness)
    lower = np.zeros((band + 1, size))
    below = entries.row >= entries.col
    lower[(entries.row - entries.col)[below], entries.col[below]] = entries.data[below]
    if size:
        lower = scipy.linalg.cholesky_banded(lower, lower=True)
    wide = -(-band // 8) * 8  # whole vectors: zeros cost less than a remainder
    columns, rows = np.zeros((2, size, wide))
    columns[:, :band] = lower[1:].T
    for i in range(1, band + 1):
        rows[i:, wide - i] = lower[i, : size - i]
    number = spectrum.free[order]
    scale = 1.0 / np.sqrt(spectrum.masses[order])
    return Factor(number, scale.astype(dtype), (1.0 / lower[0]).astype(dtype), columns.astype(dtype), rows.astype(dtype))


def bandwidth(spectrum: Spectrum) -> int:
    """Of a factor with damping and stiffness."""
    return _reordered(spectrum, 1.0, 1.0)[2]


def _reordered(spectrum: Spectrum, damping: float, stiffness: float) -> tuple[NDArray[np.intp], Any, int]:
    """Order of the unknowns, entries of I + damping Z + stiffness K in that order, and its half bandwidth."""
    size = len(spectrum.free)
    matrix = scipy.sparse.csr_array(scipy.sparse.eye_array(size) + damping * spectrum.damping + stiffness * spectrum.stiffness)
    order = np.asarray(reverse_cuthill_mckee(matrix, symmetric_mode=True), np.intp) if size else np.zeros(0, np.intp)
    entries = scipy.sparse.coo_array(matrix[order][:, order])
    return order, entries, int(np.abs(entries.row - entries.col).max(initial=0))


@kernel
def _forward(a, b, c, inverse_pivot, columns, n, band):
    for j in range(n):
        p = a[j] * inverse_pivot[j]
        q = b[j] * inverse_pivot[j]
        r = c[j] * inverse_pivot[j]
        a[j] = p
        b[j] = q
        c[j] = r
        for i in range(min(band, n - 1 - j)):
            k = uint64(j + 1) + uint64(i)  # unsigned: a signed sum might wrap round, and the loop would not vectorise
            a[k] -= columns[j, i] * p
            b[k] -= columns[j, i] * q
            c[k] -= columns[j, i] * r


@kernel
def _backward(a, b, c, inverse_pivot, rows, n, band):
    for back in range(n):
        j = n - 1 - back
        p = a[j] * inverse_pivot[j]
        q = b[j] * inverse_pivot[j]
        r = c[j] * inverse_pivot[j]
        a[j] = p
        b[j] = q
        c[j] = r
        m = min(band, j)
        for i in range(m):
            k = uint64(j - m) + uint64(i)
            w = rows[j, uint64(band - m) + uint64(i)]
            a[k] -= w * p
            b[k] -= w * q
            c[k] -= w * r


@kernel
def _residual(r, f, change, order, scale, h, n):
    for i in range(n):
        t = order[i]
        r[i] = h * scale[i] * f[t] - change[t] / scale[i]


@kernel
def _correct(change, r, order, scale, n):
    for i in range(n):
        change[order[i]] += scale[i] * r[i]


@kernel
def _excess(r, change, order, scale, share, floor, n):
    """Twice the kinetic energy of a correction, less that of a share of the whole change of velocity and of a least speed."""
    excess = 0.0
    for i in range(n):
        momentum = change[order[i]] / scale[i]
        least = floor / scale[i]
        excess += r[i] * r[i] - share * share * momentum * momentum - least * least
    return excess


@jit
def is_settled(factor, change, r, share, floor):
    """Whether the last `improve` moved velocities by less than a share of their change, or by less than `floor` [m/s]."""
    excess = 0.0
    for d in range(change.shape[0]):
        excess += _excess(r[d], change[d], factor.order, factor.scale, share, floor, factor.columns.shape[0])
    return excess <= 0.0


@jit
def improve(factor, change, f, r, h):
    """One quasi-Newton step of M change = h F for the change of velocity: change += A^-1 (h f - M change).

    `r` (3, particles) is work space, and holds the correction afterwards, each particle's times the root of its mass; rows that
    `change` does not have must hold finite numbers.
    """
    n, band = factor.columns.shape
    for d in range(change.shape[0]):
        _residual(r[d], f[d], change[d], factor.order, factor.scale, h, n)
    _forward(r[0], r[1], r[2], factor.inverse_pivot, factor.columns, n, band)
    _backward(r[0], r[1], r[2], factor.inverse_pivot, factor.rows, n, band)
    for d in range(change.shape[0]):
        _correct(change[d], r[d], factor.order, factor.scale, n)
