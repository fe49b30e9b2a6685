"""Mass-scaled stiffness and damping of a scene's free particles as sparse matrices, from one list of its links and anchors.

The stiffness block of a spring never exceeds its stiffness in any pose, since 1 - l/d <= 1, and a damper's never its viscosity.
So scalar graph Laplacians, with weights k for K and z for Z, anchors on the diagonal of K and drag on that of Z bound every pose.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from flag_env.physics.lattice import Lattice
from flag_env.physics.limits.terms import Array, Terms


class Matrices:
    """Matrices of any weights of a scene's links and any diagonal, over the free particles in a given order.

    Parameters
    ----------
    lattice
        Masses, and which particles are free.
    terms
        The links.
    order : (free particles,)
        Flat numbers of the free particles; None: along the shortest axis of the lattice first, for narrow bands.
    """

    def __init__(self, lattice: Lattice, terms: Terms, order: NDArray[np.intp] | None = None) -> None:
        order = _narrow(lattice) if order is None else order
        number = np.full(lattice.size, -1, np.intp)
        number[order] = np.arange(len(order))
        self._roots = np.zeros(lattice.size)
        self._roots[order] = 1.0 / np.sqrt(lattice.masses[order])
        self._terms, self._order = terms, order
        everyone = np.arange(lattice.size)
        row, column = (np.concatenate([everyone, *ends]) for ends in ((terms.first, terms.second), (terms.second, terms.first)))
        self._there = (number[row] >= 0) & (number[column] >= 0)
        self._row, self._column = number[row[self._there]], number[column[self._there]]

    def of(self, weights: Array, diagonal: Array) -> Any:
        """M^-1/2 (graph Laplacian of the weights + diagonal) M^-1/2; weights by link, diagonal by particle."""
        terms, roots = self._terms, self._roots
        ends = sum(np.bincount(end, weights, len(roots)) for end in (terms.first, terms.second))
        between = -weights * roots[terms.first] * roots[terms.second]
        entries = np.concatenate([roots**2 * (ends + diagonal), between, between])[self._there]
        size = len(self._order)
        matrix = scipy.sparse.csr_array((entries, (self._row, self._column)), shape=(size, size))
        matrix.eliminate_zeros()
        return matrix


def largest_sum(matrix: Any) -> float:
    """Largest sum of magnitudes along a row of a matrix: none of its eigenvalues is larger."""
    return float(abs(matrix).sum(axis=1).max(initial=0.0))


def _narrow(lattice: Lattice) -> NDArray[np.intp]:
    """Flat numbers of the free particles, neighbours close together."""
    everyone = np.arange(lattice.size).reshape(lattice.shape)
    order = everyone.transpose(np.argsort(-np.array(lattice.shape), kind="stable")).ravel()
    return np.asarray(order[~lattice.fixed[order]])
