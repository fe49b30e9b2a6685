"""Stiffness and damping of a scene's free particles, bounded over all poses, and their top eigenvalues.

The stiffness block of a spring never exceeds its stiffness in any pose, since 1 - l/d <= 1, and a damper's never its viscosity.
So the scalar graph Laplacians K (weights k) and Z (weights z, and drag on the diagonal) of the free particles bound every pose.
Eigenvalues: Lanczos (`scipy.sparse.linalg.eigsh`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from flag_env.physics.effects.base import Effect, LinkTerm
from flag_env.physics.lattice import Lattice

_FOREVER = 1e9
"""Timestep beyond which a limit is none [s]: drag that acts within thirty years at the earliest."""

_LARGE = 20_000
"""Free particles from which on the limit is found to `_COARSE` only: the top eigenvalues lie ever closer together."""

_COARSE = 1e-3
"""Relative error of an eigenvalue that is found roughly."""

_DENSE = 60
"""Free particles up to which dense eigenvalues are quicker than Lanczos."""


class SceneSpectrum:
    """Mass-scaled stiffness and damping of a scene's free particles, bounded over all poses.

    Parameters
    ----------
    lattice, effects
        The scene's.
    scales
        Factors on stiffness and damping of effects, by their class; 1 where there is none.
    """

    def __init__(
        self, lattice: Lattice, effects: tuple[Effect, ...], scales: Mapping[type[Effect], tuple[float, float]] | None = None
    ) -> None:
        self._lattice, self._effects, self._scales = lattice, effects, scales or {}

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Flat numbers of the free particles."""
        return np.flatnonzero(~self._lattice.fixed)

    @cached_property
    def masses(self) -> NDArray[np.float64]:
        """Masses of the free particles [kg]."""
        return self._lattice.masses[self.free]

    @cached_property
    def stiffness(self) -> Any:
        """M^-1/2 K M^-1/2 [1/s^2]."""
        return self._matrix(lambda term: term.stiffness)

    @cached_property
    def damping(self) -> Any:
        """M^-1/2 Z M^-1/2 [1/s]."""
        return self._matrix(lambda term: term.viscosity, drag=True)

    @cached_property
    def _lasting(self) -> Any:
        """M^-1/2 Z M^-1/2 [1/s] of damping that acts along every direction in every pose."""
        terms = (term for effect in self._effects for term in effect.link_terms(self._lattice))
        return self.damping if all(term.isotropic for term in terms) else self._matrix(_everywhere, drag=True)

    def _holding(self, step: float) -> tuple[Any, Any]:
        """Stiffness, and damping that lasts, for which h K - Z is largest at h = `step` [s], whichever links are broken.

        A link with step k <= z is worse broken than whole.
        """
        if not self._breaks:
            return self.stiffness, self._lasting

        def holds(term: LinkTerm, stiffness: float, viscosity: float) -> NDArray[np.bool_]:
            return stiffness * term.stiffness > viscosity / step * _everywhere(term)

        return self._matrix(lambda term: term.stiffness, among=holds), self._matrix(_everywhere, drag=True, among=holds)

    @property
    def _breaks(self) -> bool:
        return any(effect.breaks for effect in self._effects)

    def _matrix(
        self,
        weight: Callable[[LinkTerm], NDArray[np.float64]],
        drag: bool = False,
        among: Callable[[LinkTerm, float, float], NDArray[np.bool_]] | None = None,
    ) -> Any:
        laplacian = _Laplacian(self._lattice.size)
        for effect in self._effects:
            scales = self._scales.get(type(effect), (1.0, 1.0))
            scale = scales[drag]
            for term in effect.link_terms(self._lattice):
                chosen = scale * weight(term)
                laplacian.add(term.family.offset, chosen if among is None else chosen * among(term, *scales))
            own = effect.drag(self._lattice) if drag else None
            if own is not None:
                laplacian.diagonal += scale * own
        return laplacian.matrix(self.free, self.masses)

    def sure_step(self, quadratic: float, linear: float, bound: float) -> float:
        """See `Spectrum`. From the largest sums of magnitudes along a row, which no eigenvalue exceeds."""
        stiffness, damping = self._largest_sums
        return _root(quadratic * stiffness, max(linear, 0.0) * damping, bound)

    @cached_property
    def _largest_sums(self) -> tuple[float, float]:
        stiffness, damping = (float(abs(part).sum(axis=1).max(initial=0.0)) for part in (self.stiffness, self.damping))
        return stiffness, damping

    def largest_step(self, quadratic: float, linear: float, bound: float, enough: float = math.inf) -> float:
        """See `Spectrum`. Newton's iteration on h from above: with the top vector u of the last matrix, solve for h in
        quadratic h^2 u'Ku + linear h u'Zu = bound; u gives a lower bound of the eigenvalue, so h never falls below the root.
        """
        step = self.sure_step(quadratic, linear, bound)
        if step > min(enough, _FOREVER):
            return step if step <= _FOREVER else math.inf
        step = enough if math.isfinite(enough) else step
        vector, coarse = None, self.stiffness.shape[0] > _LARGE
        stiffness, damping = self.stiffness, self.damping
        for turn in range(50):
            if linear < 0.0:
                stiffness, damping = self._holding(-step * quadratic / linear)
            matrix = quadratic * step**2 * stiffness + linear * step * damping
            vector = self._top_vector(matrix, vector, _COARSE if coarse or not turn else 1e-6)
            a = quadratic * float(vector @ (stiffness @ vector))
            b = linear * float(vector @ (damping @ vector))
            last, step = step, _root(a, b, bound)
            if step > _FOREVER:
                return math.inf
            if step > (1.0 + 10.0 * _COARSE) * enough:
                return step
            if abs(step - last) <= (_COARSE if coarse else 1e-9) * step:
                break
        return (1.0 - 2.0 * _COARSE) * step if coarse else step  # on the safe side of what a coarse vector leaves open

    def damped_step(self) -> float:
        """See `Spectrum`. The inverse of the top eigenvalue of K u = e Z u; 0 where a mode is elastic but not damped.

        Links that are worse broken than whole at that step leave K and Z, which lowers it, until none does.
        """
        if not self.stiffness.nnz:
            return math.inf
        fastest = self.sure_step(1.0, 0.0, 1.0)
        last, step = math.inf, self._damped_step(*self._holding(math.inf), fastest)
        while self._breaks and 0.0 < step < (1.0 - 1e-9) * last:
            stiffness, damping = self._holding(step)
            last = step
            if stiffness.nnz:
                step = min(step, self._damped_step(stiffness, damping, fastest))
        return step

    def _damped_step(self, stiffness: Any, damping: Any, fastest: float) -> float:
        size = stiffness.shape[0]
        # far below any useful step, and keeps Z invertible where a mode has neither stiffness nor damping
        floor = 1e-7 * fastest * stiffness + 1e-7 / fastest * scipy.sparse.eye_array(size)
        shifted = scipy.sparse.csc_array(damping + floor)
        if size <= _DENSE:
            top = scipy.linalg.eigh(stiffness.toarray(), shifted.toarray(), eigvals_only=True)[-1]
        else:
            factor = scipy.sparse.linalg.splu(
                shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
            inverse = scipy.sparse.linalg.LinearOperator(shifted.shape, matvec=factor.solve, dtype=np.float64)
            found = scipy.sparse.linalg.eigsh(stiffness, k=1, M=shifted, Minv=inverse, which="LA", v0=self._start, tol=1e-6)
            top = found[0][0]
        step = 1.0 / float(top)
        return step if step > 1e-4 * fastest else 0.0

    def _top_vector(self, matrix: Any, start: NDArray[np.float64] | None, tolerance: float) -> NDArray[np.float64]:
        size = matrix.shape[0]
        if size <= _DENSE:
            vectors = scipy.linalg.eigh(matrix.toarray(), subset_by_index=(size - 1, size - 1))[1]
        else:
            first = self._start if start is None else start
            vectors = scipy.sparse.linalg.eigsh(matrix, k=1, which="LA", v0=first, tol=tolerance)[1]
        return np.asarray(vectors[:, 0])

    @cached_property
    def _start(self) -> NDArray[np.float64]:
        return np.random.default_rng(0).standard_normal(int(self.stiffness.shape[0]))


def _root(a: float, b: float, bound: float) -> float:
    """Positive h with a h^2 + b h = bound, for a >= 0; infinite where there is none."""
    turn = b + math.sqrt(b * b + 4.0 * a * bound)
    return 2.0 * bound / turn if turn > 0.0 else math.inf


def _everywhere(term: LinkTerm) -> NDArray[np.float64]:
    """Viscosity that acts along every direction in every pose [N s/m]."""
    return term.viscosity if term.isotropic else np.zeros_like(term.viscosity)


class _Laplacian:
    """Weighted graph Laplacian, built family by family."""

    def __init__(self, size: int) -> None:
        self.diagonal = np.zeros(size)
        self.bands: dict[int, Any] = {}

    def add(self, offset: int, weight: NDArray[np.float64]) -> None:
        self.diagonal[: len(weight)] += weight
        self.diagonal[offset:] += weight
        self.bands[offset] = self.bands.get(offset, 0.0) - weight  # on narrow lattices two directions share an offset

    def matrix(self, free: NDArray[np.intp], masses: NDArray[np.float64]) -> Any:
        """Its rows and columns of the free particles, divided by the roots of their masses; entries of nothing left out."""
        roots, number = np.zeros(len(self.diagonal)), np.full(len(self.diagonal), -1)
        roots[free], number[free] = 1.0 / np.sqrt(masses), np.arange(len(free))
        entries = [roots**2 * self.diagonal]
        rows, columns = [number], [number]
        for offset, band in self.bands.items():
            scaled = roots[:-offset] * band * roots[offset:]
            entries += [scaled, scaled]
            rows += [number[:-offset], number[offset:]]
            columns += [number[offset:], number[:-offset]]
        entry, row, column = (np.concatenate(parts) for parts in (entries, rows, columns))
        there = entry != 0.0  # a pinned particle's root is nothing
        size = len(free)
        return scipy.sparse.csr_array((entry[there], (row[there], column[there])), shape=(size, size))
