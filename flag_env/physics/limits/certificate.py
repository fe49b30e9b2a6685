"""The largest h at which G(h) = r I - p h^2 K - q h Z is positive definite: proposed by Lanczos, proven by Cholesky.

Any vector u gives an upper bound: the root of u' G(h) u = 0. The top eigenvector of p h^2 K + q h Z at some h gives a better one,
and with that the next; this is Newton's iteration, from above. Where q < 0, Z counts on the other side, as p h^2 K against
r I - q h Z: else the largest eigenvalue would hide in the spread of the others. What Lanczos' method leaves open is below
`MARGIN`, so a step that much below is nearly always proven by the first factor; where it is not, bisection goes on.
Source: Golub, Van Loan, Matrix Computations, 4.2, 8.7 and 10.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from flag_env.physics.integrators import positive_root

Array = NDArray[np.float64]
Line = tuple[float, float, float]
"""p, q, r."""
Parts = Callable[[float], tuple[Any, Any]]
"""K and Z for a step, sparse: the same for every one, but where links may break."""

MARGIN = 1e-3
"""How far below the step that Lanczos' method proposes one is proven, in parts of it."""

_TOLERANCE = 3e-4
"""Relative error of an eigenvalue at which Lanczos' method ends."""

_NEAR = 1e-2
"""Relative change by one of Newton's steps after which the next, its square, would be none."""

_ROUNDS = 30
"""More of Newton's steps than it ever takes."""

_LARGE = 4e9
"""Multiplications in a banded factor from which on a sparse one is quicker."""


class Pencil:
    """G along a line (p, q, r)."""

    def __init__(self, line: Line, parts: Parts) -> None:
        self._line, self._parts = line, parts

    def is_definite(self, step: float) -> bool:
        """Whether G(step) is positive definite."""
        p, q, r = self._line
        stiffness, damping = self._parts(step)
        return factor(_sum(r, -p * step**2, stiffness, -q * step, damping)) is not None

    def edge(self, lower: float) -> tuple[float, Array]:
        """That h, at most some `MARGIN` below, and the vector that bounds it from above.

        `lower` is a bound of it, known beforehand, and positive.
        """
        upper, vector = self._proposal(lower)
        lower, trial = min(lower, upper), (1.0 - MARGIN) * upper
        while trial > lower:
            if self.is_definite(trial):
                lower = trial
            else:
                upper = trial
            trial = math.sqrt(lower * upper) if lower < (1.0 - 2.0 * MARGIN) * upper else lower
        return lower, vector

    def _proposal(self, start: float) -> tuple[float, Array]:
        """An upper bound that lies close, and its vector."""
        stiffness, _ = self._parts(math.inf)
        vector = np.random.default_rng(0).standard_normal(stiffness.shape[0])
        if self._line[1] < 0.0:  # begin above it: below, all links might be broken
            vector = _lanczos(stiffness, vector)
            start = self._root(math.inf, vector)
        step, last = start, math.inf
        for _ in range(_ROUNDS):
            vector = self._top(step, vector)
            last, step = step, self._root(step, vector)
            if not step < math.inf or abs(last - step) < _NEAR * step:
                break
        return step, vector

    def _top(self, step: float, vector: Array) -> Array:
        """The top eigenvector at a step, nearly."""
        p, q, r = self._line
        stiffness, damping = self._parts(step)
        if q >= 0.0:
            return _lanczos(_sum(0.0, p * step**2, stiffness, q * step, damping), vector)
        against = _sum(r, 0.0, stiffness, -q * step, damping)
        solve = factor(against)
        return vector if solve is None else _lanczos(p * step**2 * stiffness, vector, against, solve)

    def _root(self, step: float, vector: Array) -> float:
        """Where u' G(h) u = 0 with the links that hold at a step."""
        stiffness, damping = self._parts(step)
        p, q, r = self._line
        k, z = float(vector @ (stiffness @ vector)), float(vector @ (damping @ vector))
        return positive_root(p * k, q * z, r * float(vector @ vector))


def _sum(one: float, a: float, stiffness: Any, b: float, damping: Any) -> Any:
    return one * scipy.sparse.eye_array(stiffness.shape[0], format="csr") + a * stiffness + b * damping


def _lanczos(matrix: Any, start: Array, against: Any = None, solve: Callable[[Array], Array] | None = None) -> Array:
    size = matrix.shape[0]
    if size < 3:  # too small for Lanczos' method
        return start if size == 1 else _dense_top(matrix, against)
    inverse = None if solve is None else LinearOperator((size, size), matvec=solve, dtype=np.float64)
    try:
        found = eigsh(matrix, 1, against, which="LA", v0=start, Minv=inverse, tol=_TOLERANCE, ncv=min(20, size))
        return np.asarray(found[1][:, 0])
    except ArpackError:
        return start


def _dense_top(matrix: Any, against: Any) -> Array:
    return np.asarray(scipy.linalg.eigh(matrix.toarray(), None if against is None else against.toarray())[1][:, -1])


def factor(matrix: Any) -> Callable[[Array], Array] | None:
    """Solves with a symmetric sparse matrix, banded or, where wide, sparse; None where it is not positive definite."""
    entries = scipy.sparse.coo_array(matrix)
    down, size = entries.row - entries.col, matrix.shape[0]
    width = int(down.max(initial=0))
    if size * width**2 > _LARGE:
        matrix = scipy.sparse.csc_array(matrix)
        options = {"SymmetricMode": True}
        solver = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        return solver.solve if (solver.U.diagonal() > 0.0).all() else None
    band, lower = np.zeros((width + 1, size), order="F"), down >= 0
    band[down[lower], entries.col[lower]] = entries.data[lower]
    band, failed = lapack.dpbtrf(band, lower=1, overwrite_ab=1)
    return None if failed else lambda vector: lapack.dpbtrs(band, vector, lower=1)[0]
