"""The largest steps that a scene's stiffness and damping allow, bounded over all poses.

Found by banded Cholesky factors from below and Rayleigh quotients from above (`flag_env.physics.definite`); on lattices too large
for that by Lanczos (`scipy.sparse.linalg.eigsh`).
"""

from __future__ import annotations

import math
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray

from flag_env.physics.definite import Line, Pencil, root
from flag_env.physics.effects.base import Effect
from flag_env.physics.lattice import Lattice
from flag_env.physics.matrices import LinkMatrices, Scales

_FOREVER = 1e9
"""Timestep beyond which a limit is none [s]: drag that acts within thirty years at the earliest."""

_LARGE = 4e9
"""Multiplications in a banded factor from which on the limit is found to `_COARSE` only."""

_COARSE = 1e-3
"""Relative error of an eigenvalue that is found roughly."""

_GROWTH = 1e-12
"""Growth of a squared amplitude in one step that counts as none."""

_DAMPED = 1e-4
"""Smallest step that damping earns, in units of what the fastest oscillation would allow; below it a mode is all but undamped."""

_NEAR = 3e-4
"""How far below the root of another line's vector an edge is sought first."""


class SceneSpectrum:
    """Mass-scaled stiffness and damping of a scene's free particles, bounded over all poses.

    Parameters
    ----------
    lattice, effects
        The scene's.
    scales
        Factors on stiffness and damping of effects, by their class; 1 where there is none.
    """

    def __init__(self, lattice: Lattice, effects: tuple[Effect, ...], scales: Scales | None = None) -> None:
        self._lattice, self._effects, self._scales = lattice, effects, scales or {}
        self._last: NDArray[np.float64] | None = None
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
        return self._links.sparse(self._links.stiffness)

    @cached_property
    def damping(self) -> Any:
        """M^-1/2 Z M^-1/2 [1/s]."""
        return self._links.sparse(self._links.viscosity, self._links.drag)

    @cached_property
    def _links(self) -> LinkMatrices:
        return LinkMatrices(self._lattice, self._effects, self._scales)

    def sure_step(self, quadratic: float, linear: float, bound: float) -> float:
        """See `Spectrum`. From the largest sums of magnitudes along a row, which no eigenvalue exceeds."""
        stiffness, damping = self._largest_sums
        return root(quadratic * stiffness, max(linear, 0.0) * damping, bound)

    @cached_property
    def _largest_sums(self) -> tuple[float, float]:
        links = self._links
        return links.largest_sum(links.stiffness), links.largest_sum(links.viscosity, links.drag)

    def largest_step(self, quadratic: float, linear: float, bound: float, enough: float = math.inf, least: float = 0.0) -> float:
        """See `Spectrum`. Where bound I - quadratic h^2 K - linear h Z ceases to be positive definite."""
        step, line = self.sure_step(quadratic, linear, bound), (quadratic, linear, bound)
        if step > min(enough, _FOREVER):
            return step if step <= _FOREVER else math.inf
        return self._coarse_step(line, step, enough) if self._is_large else self._edge(line, step, enough, least)[0]

    def damped_step(self, enough: float = math.inf) -> float:
        """See `Spectrum`. Where Z - h K ceases to be positive definite; 0 where a mode is elastic but not damped."""
        line = (1.0, -1.0, _GROWTH)
        fastest = self.sure_step(1.0, 0.0, 1.0)
        if fastest > _FOREVER:
            return math.inf
        step, vector = self._edge(line, self.sure_step(*line), enough)
        stiffness, damping = self._parts(line, step)
        elastic = float(vector @ (stiffness @ vector))
        if elastic > 0.0:  # the allowed growth aside
            step = min(step, float(vector @ (damping @ vector)) / elastic)
        return step if step > _DAMPED * fastest else 0.0

    def _edge(self, line: Line, step: float, enough: float, least: float = 0.0) -> tuple[float, NDArray[np.float64]]:
        pencil = Pencil(line, partial(self._parts, line), self._work)
        if math.isfinite(enough) and pencil.is_definite(enough):
            return enough, np.zeros_like(self._random)
        if least > step:
            if not pencil.is_definite(least):
                return step, np.zeros_like(self._random)
            step = least
        start = self._random
        if self._last is not None:  # the modes of neighbouring lines are much alike
            start = self._last + 0.1 * self._random
            near = (1.0 - _NEAR) * min(enough, pencil.root_of(self._last))
            if step < near < math.inf and pencil.is_definite(near):
                step = near
        step, self._last = pencil.edge(step, enough, start)
        return step, self._last

    def _parts(self, line: Line, step: float) -> tuple[Any, Any]:
        """K, and Z or, where q < 0, the part of it that lasts, for which the line is worst at a step, whichever links are broken.

        A link with p h k <= -q z is worse broken than whole.
        """
        if line[1] >= 0.0:
            return self._springs, self._dampers
        if not any(effect.breaks for effect in self._effects):
            return self._springs, self._lasting_dampers
        links = self._links
        holds = line[0] * links.stiffness > -line[1] / step * links.lasting
        if holds.tobytes() not in self._holding:
            make = links.sparse if self._is_large else links.banded
            self._holding[holds.tobytes()] = make(links.stiffness * holds), make(links.lasting * holds, links.lasting_drag)
        return self._holding[holds.tobytes()]

    @cached_property
    def _is_large(self) -> bool:
        return self._lattice.size * self._links.width**2 > _LARGE

    @cached_property
    def _springs(self) -> Any:
        return self.stiffness if self._is_large else self._links.banded(self._links.stiffness)

    @cached_property
    def _dampers(self) -> Any:
        return self.damping if self._is_large else self._links.banded(self._links.viscosity, self._links.drag)

    @cached_property
    def _lasting_dampers(self) -> Any:
        make = self._links.sparse if self._is_large else self._links.banded
        return make(self._links.lasting, self._links.lasting_drag)

    @cached_property
    def _random(self) -> NDArray[np.float64]:
        vector = np.random.default_rng(0).standard_normal(len(self.free) if self._is_large else self._lattice.size)
        return np.asarray(vector / np.linalg.norm(vector))

    @cached_property
    def _work(self) -> NDArray[np.float64] | None:
        return None if self._is_large else np.empty_like(self._springs.band)

    def _coarse_step(self, line: Line, step: float, enough: float) -> float:
        """Newton's iteration on h from above: with the top vector u of p h^2 K + q h Z, the root of p h^2 u'Ku + q h u'Zu = r."""
        p, q, r = line
        step = enough if math.isfinite(enough) else step
        vector = self._random
        for _ in range(50):
            stiffness, damping = self._parts(line, step)
            matrix = p * step**2 * stiffness + q * step * damping
            vector = scipy.sparse.linalg.eigsh(matrix, k=1, which="LA", v0=vector, tol=_COARSE)[1][:, 0]
            last, step = step, root(p * float(vector @ (stiffness @ vector)), q * float(vector @ (damping @ vector)), r)
            if step > _FOREVER:
                return math.inf
            if step > (1.0 + 10.0 * _COARSE) * enough:
                return step
            if abs(step - last) <= _COARSE * step:
                break
        return (1.0 - 2.0 * _COARSE) * step  # on the safe side of what a coarse vector leaves open
