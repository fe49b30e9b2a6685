"""The largest steps that a scene's stiffness and damping allow, bounded over all poses."""

from __future__ import annotations

import math
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.effects import Effect
from flag_env.physics.integrators import positive_root
from flag_env.physics.lattice import Lattice
from flag_env.physics.limits.certificate import Line, Pencil
from flag_env.physics.limits.operators import Matrices, largest_sum
from flag_env.physics.limits.terms import Scales, Terms, terms_of

_FOREVER = 1e9
"""Timestep beyond which a limit is none [s]: drag that acts within thirty years at the earliest."""

_GROWTH = 1e-12
"""Growth of a squared amplitude in one step that counts as none."""

_DAMPED = 1e-4
"""Smallest step that damping earns, in units of what the fastest oscillation would allow; below it a mode is all but undamped."""


class SceneSpectrum:
    """Mass-scaled stiffness and damping of a scene's free particles, bounded over all poses.

    Parameters
    ----------
    lattice, effects
        The scene's.
    scales
        Factors on stiffness and damping of effects, by their keys; 1 where there is none.
    """

    def __init__(self, lattice: Lattice, effects: tuple[Effect, ...], scales: Scales | None = None) -> None:
        self._lattice, self._effects, self._scales = lattice, effects, scales or {}
        self._holding: dict[bytes, tuple[Any, Any]] = {}

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
        return Matrices(self._lattice, self._terms, self.free).of(self._terms.stiffness, self._terms.anchor)

    @cached_property
    def damping(self) -> Any:
        """M^-1/2 Z M^-1/2 [1/s]."""
        return Matrices(self._lattice, self._terms, self.free).of(self._terms.viscosity, self._terms.drag)

    @cached_property
    def _terms(self) -> Terms:
        return terms_of(self._lattice, self._effects, self._scales)

    @cached_property
    def _matrices(self) -> Matrices:
        return Matrices(self._lattice, self._terms)

    def guaranteed_step(self, quadratic: float, linear: float, bound: float) -> float:
        """See `Spectrum`. From the largest sums of magnitudes along a row, which no eigenvalue exceeds."""
        stiffness, damping = self._largest_sums
        return positive_root(quadratic * stiffness, max(linear, 0.0) * damping, bound)

    @cached_property
    def _largest_sums(self) -> tuple[float, float]:
        stiffness, damping = self._whole
        return largest_sum(stiffness), largest_sum(damping)

    def largest_step(
        self, quadratic: float, linear: float, bound: float, stop_above: float = math.inf, least: float = 0.0
    ) -> float:
        """See `Spectrum`. Where bound I - quadratic h^2 K - linear h Z ceases to be positive definite."""
        step, line = self.guaranteed_step(quadratic, linear, bound), (quadratic, linear, bound)
        if step > _FOREVER:
            return math.inf
        if step > stop_above:
            return step
        pencil = Pencil(line, partial(self._parts, line))
        if math.isfinite(stop_above) and pencil.is_definite(stop_above):
            return stop_above
        if least > step:
            if not pencil.is_definite(least):
                return step
            step = least
        step = pencil.edge(step)[0]
        return step if step <= _FOREVER else math.inf

    def damped_step(self, stop_above: float = math.inf) -> float:
        """See `Spectrum`. Where Z - h K ceases to be positive definite; 0 where a mode is elastic but not damped."""
        line = (1.0, -1.0, _GROWTH)
        fastest = self.guaranteed_step(1.0, 0.0, 1.0)
        if fastest > _FOREVER:
            return math.inf
        pencil = Pencil(line, partial(self._parts, line))
        if math.isfinite(stop_above) and pencil.is_definite(stop_above):
            return stop_above
        step, vector = pencil.edge(self.guaranteed_step(*line))
        stiffness, damping = self._parts(line, step)
        elastic = float(vector @ (stiffness @ vector))
        if elastic > 0.0:  # the allowed growth aside
            step = min(step, float(vector @ (damping @ vector)) / elastic)
        return step if step > _DAMPED * fastest else 0.0

    def _parts(self, line: Line, step: float) -> tuple[Any, Any]:
        """K, and Z or, where q < 0, the part of it that lasts, for which the line is worst at a step, whichever links are broken.

        A link with p h k <= -q z is worse broken than whole.
        """
        if line[1] >= 0.0:
            return self._whole
        terms = self._terms
        holds = np.ones(len(terms.first), bool)
        if any(effect.breaks for effect in self._effects):
            holds = line[0] * terms.stiffness > -line[1] / step * terms.lasting
        if holds.tobytes() not in self._holding:
            of = self._matrices.of
            self._holding[holds.tobytes()] = (
                of(terms.stiffness * holds, terms.anchor),
                of(terms.lasting * holds, terms.lasting_drag),
            )
        return self._holding[holds.tobytes()]

    @cached_property
    def _whole(self) -> tuple[Any, Any]:
        terms, of = self._terms, self._matrices.of
        return of(terms.stiffness, terms.anchor), of(terms.viscosity, terms.drag)
