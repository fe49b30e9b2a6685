"""The largest h at which G(h) = r I - p h^2 K - q h Z is positive definite, between bounds that close in on it from both sides.

From below: a step that Cholesky's factor proves safe. From above: any vector u gives the root of u' G(h) u = 0, and the best u
lies nearly in the span of u, B u, B^2 u ..., B = G^-1 (r I + p h^2 K) at the safe step; the nearer that step, the better. A
vector of neighbouring modes serves as well as an eigenvector, so modes that lie close together cost nothing.
Source: Golub, Van Loan, Matrix Computations, 4.2, 8.7 and 10.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

Array = NDArray[np.float64]
Line = tuple[float, float, float]
"""p, q, r."""

SHARP = 1e-9
"""Relative distance of the bounds at which they are close enough."""

_SPAN = 10
"""Vectors in a span."""

_CARE = 4.0
"""What a span may miss, in units of what its last two vectors brought."""

_TURNS = 200
"""Many more factors than it ever takes."""


class Banded:
    """A symmetric matrix of few diagonals, in LAPACK's lower band storage: `band[i, j]` is the entry (j + i, j)."""

    def __init__(self, band: Array) -> None:
        self.band = band

    def __matmul__(self, vector: Array) -> Array:
        return np.asarray(blas.dsbmv(self.band.shape[0] - 1, 1.0, self.band, vector, lower=1))


class Pencil:
    """G.

    Parameters
    ----------
    line
        p, q and r.
    parts
        K and Z for a step: the same for every one, but where links may break. `Banded`, or sparse where that is too wide.
    work
        Memory of a band's size for the factor; None for sparse parts.
    """

    def __init__(self, line: Line, parts: Callable[[float], tuple[Any, Any]], work: Array | None) -> None:
        self._line, self._parts = line, parts
        self._work = work

    def is_definite(self, step: float) -> bool:
        """Whether G(step) is positive definite."""
        return self._factor(step) is not None

    def root_of(self, vector: Array) -> float:
        """Step at which u' G(h) u = 0: that h at least."""
        stiffness, damping = self._parts(math.inf)
        p, q, r = self._line
        return root(p * float(vector @ (stiffness @ vector)), q * float(vector @ (damping @ vector)), r * float(vector @ vector))

    def edge(self, lower: float, upper: float, start: Array) -> tuple[float, Array]:
        """That h, at most `SHARP` below, and the vector u.

        Parameters
        ----------
        lower, upper
            Bounds of it, known beforehand: 0 < lower; upper may be infinite.
        start
            A random vector.
        """
        p, q, _ = self._line
        stiffness, damping = self._parts(upper)
        vector = p * lower**2 * (stiffness @ start) + abs(q) * lower * (damping @ start)  # nothing at pinned particles
        factor, turns = self._factor(lower), 0
        while factor is not None and lower < (1.0 - SHARP) * upper and turns < _TURNS:
            upper, width, vector = self._best(self._span(factor, lower, upper, vector), upper)
            factor = None
            while factor is None and lower < (1.0 - SHARP) * upper and turns < _TURNS:
                turns += 1
                trial = max(upper - max(width, 0.5 * SHARP * upper), math.sqrt(lower * upper))
                factor = self._factor(trial)
                if factor is None:
                    upper, width = trial, 8.0 * max(width, SHARP * upper)
                else:
                    lower = trial
        return lower, vector

    def _span(self, factor: Callable[[Array], Array], lower: float, upper: float, vector: Array) -> Array:
        """Orthonormal rows, and K times each."""
        p, _, r = self._line
        stiffness, _ = self._parts(upper)
        rows, times = np.zeros((2, _SPAN, len(vector)))
        for count in range(_SPAN):
            length = np.linalg.norm(vector)
            for _ in range(2):
                vector = vector - (rows[:count] @ vector) @ rows[:count]
            left = np.linalg.norm(vector)
            if not left > 1e-10 * length:  # it lies in the span already
                return np.stack([rows[:count], times[:count]])
            rows[count] = vector / left
            times[count] = stiffness @ rows[count]
            vector = factor(r * rows[count] + p * lower**2 * times[count])
        return np.stack([rows, times])

    def _best(self, span: Array, upper: float) -> tuple[float, float, Array]:
        """Least root over a span, or `upper` if that is smaller; by how much it may be too large; and its vector."""
        p, q, r = self._line
        (rows, times), (stiffness, damping) = span, self._parts(upper)
        while True:
            a = p * (rows @ times.T)
            b = q * (rows @ np.stack([damping @ row for row in rows]).T)
            found, mix = _least(a, b, r)
            some = _least(a[:-2, :-2], b[:-2, :-2], r)[0] if len(rows) == _SPAN else found
            last, (stiffness, damping) = stiffness, self._parts(min(upper, found))
            if stiffness is last:
                near = found < (1.0 + 0.1 * SHARP) * upper
                return min(upper, found), _CARE * (some - found) if near else math.inf, mix @ rows
            times = np.stack([stiffness @ row for row in rows])  # fewer links are worse whole than broken

    def _factor(self, step: float) -> Callable[[Array], Array] | None:
        """Solves with G(step), until the next is made; None where that is not positive definite."""
        p, q, r = self._line
        stiffness, damping = self._parts(step)
        if self._work is not None:
            band = np.multiply(stiffness.band, -p * step**2, out=self._work)
            blas.daxpy(damping.band.ravel("K"), band.ravel("K"), a=-q * step)
            band[0] += r
            lower, failed = lapack.dpbtrf(band, lower=1, overwrite_ab=1)
            return None if failed else lambda vector: lapack.dpbtrs(lower, vector, lower=1)[0]
        matrix = r * scipy.sparse.eye_array(stiffness.shape[0]) - p * step**2 * stiffness - q * step * damping
        solver = scipy.sparse.linalg.splu(
            scipy.sparse.csc_array(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        return solver.solve if (solver.U.diagonal() > 0.0).all() else None


def root(a: float, b: float, bound: float) -> float:
    """Positive h with a h^2 + b h = bound, for a >= 0 and bound >= 0; infinite where there is none."""
    a = max(a, 0.0)  # but for round-off
    spread = math.sqrt(b * b + 4.0 * a * bound)
    if b < 0.0:
        return 0.5 * (spread - b) / a if a > 0.0 else math.inf
    return 2.0 * bound / (b + spread) if b + spread > 0.0 else math.inf


def _least(a: Array, b: Array, bound: float) -> tuple[float, Array]:
    """Least root of c' (a h^2 + b h) c = bound c' c, infinite where there is none, and c: Newton's iteration from above."""
    unit = np.eye(len(a))
    roots = [root(*entries, bound) for entries in zip(a.diagonal().tolist(), b.diagonal().tolist(), strict=True)]
    step, mix = math.inf, np.zeros(len(a))
    found, vector = (min(roots), unit[int(np.argmin(roots))]) if roots else (step, mix)
    while found < (1.0 - 1e-14) * step:
        step, mix = found, vector
        vector = np.linalg.eigh(step**2 * a + step * b)[1][:, -1]
        found = root(float(vector @ a @ vector), float(vector @ b @ vector), bound)
    return step, mix
