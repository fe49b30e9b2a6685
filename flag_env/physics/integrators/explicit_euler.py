"""Explicit Euler: the scheme of the report's first program, kept to show why not.

    x_{n+1} = x_n + h v_n ;   v_{n+1} = v_n + h F(x_n, v_n, t_n) / m

Order 1, one force evaluation a step. It drives every oscillation: a mode of frequency w and damping rate c is multiplied by
|1 + h L|^2 = 1 - h c + h^2 w^2 a step, so only damping can keep it in hand.

Step limit: |1 + h L| <= 1 for both roots of L^2 + c L + w^2 = 0, in every pose, where the stiffness is anything from nothing to
its bound: h w^2 <= c and h c <= 2. As matrices: h K <= Z, counting only damping that acts along every direction, and the top
eigenvalue of h M^-1 Z at most 2. Sharp where K and Z share their modes, safe where not. 0 without damping or with axial dampers
alone, which leave a taut cloth's vibrations across its links undamped. Parameters: none.
Source: Hairer, Lubich, Wanner, Geometric Numerical Integration, I.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flag_env.physics.compiling import forces, jit, kernel
from flag_env.physics.integrators._rows import copy_rows
from flag_env.physics.integrators.base import Integrator, Spectrum


@kernel
def _drift_kick(x, v, f, inverse_mass, h, n):
    for t in range(n):
        x[t] += h * v[t]
        v[t] += h * inverse_mass[t] * f[t]


class ExplicitEulerData(NamedTuple):
    """Timestep in the scene's dtype, and in float64 for the effects' own state [s]."""

    timestep: Any
    seconds: float

    @staticmethod
    def rows() -> tuple[int, int]:
        """Rows of history and of work."""
        return 0, 0

    @staticmethod
    @jit
    def step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """Positions and velocities move on together, each by the other's old value."""
        forces(effects, copy, x, v, f, effect_work, 0.0)
        for d in range(x.shape[0]):
            _drift_kick(x[d], v[d], f[d], inverse_mass, method.timestep, x.shape[1])

    @staticmethod
    @jit
    def velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """They are at the instant of the positions as they are."""
        copy_rows(f, v)


@dataclass(frozen=True)
class ExplicitEuler(Integrator):
    """Explicit Euler: order 1, unstable at every timestep unless all motion is damped."""

    order: ClassVar[int] = 1

    def limit(self, spectrum: Spectrum) -> float:
        """Smaller of the largest h with h K <= Z and the root of the top eigenvalue of h M^-1 Z at 2 [s]."""
        elastic = spectrum.damped_step(stop_above=2.0 * spectrum.guaranteed_step(0.0, 1.0, 2.0))
        return min(elastic, spectrum.largest_step(0.0, 1.0, 2.0, stop_above=elastic))

    def bind(self, dtype: np.dtype[Any], timestep: float, spectrum: Spectrum) -> ExplicitEulerData:
        """Typed timestep."""
        del spectrum
        return ExplicitEulerData(dtype.type(timestep), float(timestep))
