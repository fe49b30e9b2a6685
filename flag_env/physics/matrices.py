"""Mass-scaled stiffness and damping of a scene's free particles as matrices, sparse or banded, from one list of its links.

The stiffness block of a spring never exceeds its stiffness in any pose, since 1 - l/d <= 1, and a damper's never its viscosity.
So scalar graph Laplacians, with weights k for K and z for Z, and drag on the diagonal of Z, bound every pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from flag_env.physics.definite import Banded
from flag_env.physics.effects.base import Effect
from flag_env.physics.lattice import Lattice

Array = NDArray[np.float64]
Scales = Mapping[type[Effect], tuple[float, float]]
"""Factors on stiffness and damping of effects, by their class; 1 where there is none."""


class LinkMatrices:
    """Links, drag and masses of a scene, and matrices of any weights of those links.

    Attributes
    ----------
    first, second : (links,)
        Flat numbers of a link's ends.
    stiffness, viscosity, lasting : (links,)
        [N/m]; [N s/m]; the viscosity that acts along every direction in every pose.
    drag, lasting_drag : (particles,)
        [N s/m]; that which acts along every direction at every velocity.
    free : (particles,) bool
        Whether a particle is free.
    """

    def __init__(self, lattice: Lattice, effects: tuple[Effect, ...], scales: Scales) -> None:
        self._lattice, self.free = lattice, ~lattice.fixed
        self._roots = np.where(self.free, 1.0 / np.sqrt(lattice.masses), 0.0)
        ends: list[Array] = []
        values: list[Array] = []
        self.drag, self.lasting_drag = np.zeros((2, lattice.size))
        for effect in effects:
            stiff, damped = scales.get(type(effect), (1.0, 1.0))
            for family, stiffness, viscosity, isotropic in effect.link_terms(lattice):
                start = np.flatnonzero((stiffness != 0.0) | (viscosity != 0.0))
                ends.append(np.stack([start, start + family.offset]))
                k, z = stiff * stiffness[start], damped * viscosity[start]
                values.append(np.stack([k, z, z * isotropic]))
            drag = effect.drag(lattice)
            if drag is not None:
                self.drag += damped * drag
                self.lasting_drag += damped * drag * effect.lasting
        self.first, self.second = np.concatenate([np.zeros((2, 0), np.intp), *ends], axis=1)
        self.stiffness, self.viscosity, self.lasting = np.concatenate([np.zeros((3, 0)), *values], axis=1)

    def _entries(self, weights: Array, drag: Array | float) -> tuple[Array, Array]:
        """Of the diagonal, by particle, and off it, by link; nothing at pinned particles."""
        at_first, at_second = (np.bincount(end, weights, self._lattice.size) for end in (self.first, self.second))
        return self._roots**2 * (at_first + at_second + drag), -weights * self._roots[self.first] * self._roots[self.second]

    def largest_sum(self, weights: Array, drag: Array | float = 0.0) -> float:
        """Largest sum of magnitudes along a row of the matrix: none of its eigenvalues is larger."""
        diagonal, between = self._entries(weights, drag)
        at_first, at_second = (np.bincount(end, between, self._lattice.size) for end in (self.first, self.second))
        return float((diagonal - at_first - at_second).max(initial=0.0))

    def sparse(self, weights: Array, drag: Array | float = 0.0) -> Any:
        """The matrix over the free particles; entries of nothing left out."""
        number, size = np.cumsum(self.free) - 1, int(self.free.sum())
        diagonal, between = self._entries(weights, drag)
        entry = np.concatenate([diagonal, between, between])
        everyone = np.arange(len(diagonal))
        row, column = (number[np.concatenate([everyone, *ends])] for ends in (self._ends, self._ends[::-1]))
        there = entry != 0.0
        return scipy.sparse.csr_array((entry[there], (row[there], column[there])), shape=(size, size))

    @property
    def _ends(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        return self.first, self.second

    def banded(self, weights: Array, drag: Array | float = 0.0) -> Banded:
        """The matrix over all particles, nothing at the pinned ones, numbered along the shortest axis of the lattice first."""
        diagonal, between = self._entries(weights, drag)
        width, size = self.width + 1, len(diagonal)
        diagonal_at, between_at = self._places
        band = np.bincount(between_at, between, size * width).astype(np.float64)  # without links it counts in whole numbers
        band[diagonal_at] += diagonal
        return Banded(band.reshape(size, width).T)

    @cached_property
    def width(self) -> int:
        """Diagonals of the banded matrix below its own."""
        apart = np.abs(self._numbers[self.first] - self._numbers[self.second])
        return int(apart[self.free[self.first] & self.free[self.second]].max(initial=0))

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        shape = np.array(self._lattice.shape)
        longest_first = np.argsort(-shape, kind="stable")
        return np.arange(self._lattice.size).reshape(shape[longest_first]).transpose(np.argsort(longest_first)).ravel()

    @cached_property
    def _places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Where entries stand in the band, by particle and by link."""
        ends = self._numbers[self.first], self._numbers[self.second]
        low, apart = np.minimum(*ends), np.abs(ends[0] - ends[1])
        within = np.where(self.free[self.first] & self.free[self.second], apart, 0)  # where an end is pinned, nothing is added
        return self._numbers * (self.width + 1), low * (self.width + 1) + within
