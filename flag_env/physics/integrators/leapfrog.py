"""The report's scheme, there called leapfrog: semi-implicit (symplectic) Euler.

    w_{n+1} = w_n + h F(x_n, w_n, t_n) / m ;   x_{n+1} = x_n + h w_{n+1}

Order 1 as started here (w_0 = v_0), with one force evaluation a step. The w are the velocities half a step before the positions;
`velocity` moves them to the same instant, v_n = w_n + h F(x_n, w_n, t_n) / (2 m), so that energies are right to O(h^2).

Step limit: stable iff the top eigenvalue of M^-1 (h^2 K + 2 h Z) stays below 4, from the characteristic polynomial
L^2 - (2 - K - Z) L + (1 - Z) = 0. Parameters: none. Source: Hairer, Lubich, Wanner, Geometric Numerical Integration, I.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flag_env.physics.compose import forces
from flag_env.physics.integrators.base import Integrator, Spectrum
from flag_env.physics.jit import jit, kernel


@kernel
def _kick_drift(x, v, f, inverse_mass, h, n):
    for t in range(n):
        v[t] += h * inverse_mass[t] * f[t]
        x[t] += h * v[t]


@kernel
def _half_kick(f, v, inverse_mass, half, n):
    for t in range(n):
        f[t] = v[t] + half * inverse_mass[t] * f[t]


class BoundLeapfrog(NamedTuple):
    """Timestep and half of it in the scene's dtype, and in float64 for the effects' own state [s]."""

    timestep: Any
    half: Any
    seconds: float

    @staticmethod
    @jit
    def step(method, effects, copy, x, v, f, scratch, inverse_mass):
        """Kick, then drift."""
        forces(effects, copy, x, v, f, scratch, 0.0)
        for d in range(x.shape[0]):
            _kick_drift(x[d], v[d], f[d], inverse_mass, method.timestep, x.shape[1])

    @staticmethod
    @jit
    def velocity(method, effects, copy, x, v, f, scratch, inverse_mass):
        """Half a kick from the velocities half a step before."""
        forces(effects, copy, x, v, f, scratch, 0.0)
        for d in range(x.shape[0]):
            _half_kick(f[d], v[d], inverse_mass, method.half, x.shape[1])


@dataclass(frozen=True)
class Leapfrog(Integrator):
    """The report's scheme: one force evaluation a step, order 1 as started, symplectic without damping."""

    order: ClassVar[int] = 1

    def limit(self, spectrum: Spectrum) -> float:
        """Root of the top eigenvalue of M^-1 (h^2 K + 2 h Z) at 4 [s]."""
        return spectrum.largest_step(1.0, 2.0, 4.0)

    def bind(self, dtype: np.dtype[Any], timestep: float) -> BoundLeapfrog:
        """Typed timesteps."""
        return BoundLeapfrog(dtype.type(timestep), dtype.type(0.5 * timestep), float(timestep))
