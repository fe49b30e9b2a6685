"""The report's scheme, there called leapfrog: semi-implicit (symplectic) Euler.

    w_{n+1} = w_n + h F(x_n, w_n, t_n) / m ;   x_{n+1} = x_n + h w_{n+1}

One force evaluation a step. The w are the velocities half a step before the positions; `velocity` moves them to the same instant,
v_n = w_n + h F(x_n, w_n, t_n) / (2 m), so that energies are right to O(h^2). Order 1 as the report starts it, w_0 = v_0; started
with half a kick back, w_0 = v_0 - h F(x_0, v_0, 0) / (2 m), it is the Stoermer-Verlet scheme, of order 2 without damping and
reversible. Damping is felt half a step late, which keeps the order at 1 in either case.

Step limit: stable iff the top eigenvalue of M^-1 (h^2 K + 2 h Z) stays below 4, from the characteristic polynomial
L^2 - (2 - K - Z) L + (1 - Z) = 0. Parameters: start. Source: Hairer, Lubich, Wanner, Geometric Numerical Integration, I.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flag_env import _validate
from flag_env.physics.compiling import forces, jit, kernel, pull_back
from flag_env.physics.integrators.base import Integrator, Spectrum


@kernel
def _kick_drift(x, v, f, inverse_mass, h, n):
    for t in range(n):
        v[t] += h * inverse_mass[t] * f[t]
        x[t] += h * v[t]


@kernel
def _half_kick(f, v, inverse_mass, half, n):
    for t in range(n):
        f[t] = v[t] + half * inverse_mass[t] * f[t]


@kernel
def _half_kick_back(f, v, inverse_mass, half, n):
    for t in range(n):
        v[t] -= half * inverse_mass[t] * f[t]


@kernel
def _drift_back(g, dx, dv, inverse_mass, h, n):
    for t in range(n):
        dv[t] += h * dx[t]
        g[t] = h * inverse_mass[t] * dv[t]


@kernel
def _half_kick_share(g, dv, after, inverse_mass, half, n):
    for t in range(n):
        dv[t] += after[t]
        g[t] = half * inverse_mass[t] * after[t]


@kernel
def _start_share(g, dv, inverse_mass, half, n):
    for t in range(n):
        g[t] = -half * inverse_mass[t] * dv[t]


class LeapfrogData(NamedTuple):
    """Timestep and half of it in the scene's dtype, and in float64 for the effects' own state [s]."""

    timestep: Any
    half: Any
    seconds: float

    @staticmethod
    def rows() -> tuple[int, int]:
        """Rows of history and of work."""
        return 0, 0

    @staticmethod
    @jit
    def step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """Kick, then drift."""
        forces(effects, copy, x, v, f, effect_work, 0.0)
        for d in range(x.shape[0]):
            _kick_drift(x[d], v[d], f[d], inverse_mass, method.timestep, x.shape[1])

    @staticmethod
    @jit
    def velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """Half a kick from the velocities half a step before."""
        forces(effects, copy, x, v, f, effect_work, 0.0)
        for d in range(x.shape[0]):
            _half_kick(f[d], v[d], inverse_mass, method.half, x.shape[1])

    @staticmethod
    def back_rows() -> int:
        """Rows of work on the way back."""
        return 1

    @staticmethod
    @jit
    def step_back(method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag):
        """Undo drift and kick."""
        g = work[0, : x.shape[0]]
        for d in range(x.shape[0]):
            _drift_back(g[d], dx[d], dv[d], inverse_mass, method.timestep, x.shape[1])
        pull_back(effects, slopes, copy, x, v, v, g, dx, dv, effect_work, lag)

    @staticmethod
    @jit
    def velocity_back(
        method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
    ):  # fmt: skip
        """Through half a kick."""
        g = work[0, : x.shape[0]]
        for d in range(x.shape[0]):
            _half_kick_share(g[d], dv[d], after[d], inverse_mass, method.half, x.shape[1])
        pull_back(effects, slopes, copy, x, v, v, g, dx, dv, effect_work, lag)


class VerletData(LeapfrogData):
    """The same, started with half a kick."""

    @staticmethod
    @jit
    def start(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """Take the velocities half a step back."""
        forces(effects, copy, x, v, f, effect_work, 0.0)
        for d in range(x.shape[0]):
            _half_kick_back(f[d], v[d], inverse_mass, method.half, x.shape[1])

    @staticmethod
    @jit
    def start_back(method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag):
        """Undo half a kick back."""
        g = work[0, : x.shape[0]]
        for d in range(x.shape[0]):
            _start_share(g[d], dv[d], inverse_mass, method.half, x.shape[1])
        pull_back(effects, slopes, copy, x, v, v, g, dx, dv, effect_work, lag)


@dataclass(frozen=True)
class Leapfrog(Integrator):
    """The report's scheme: one force evaluation a step, order 1, symplectic without damping.

    Parameters
    ----------
    start
        "report": the velocities set serve as those half a step before; "half_kick": they are moved there first, which makes the
        scheme reversible and of order 2 without damping.
    """

    order: ClassVar[int] = 1
    undamped_share: ClassVar[float] = 0.5

    start: str = "report"

    def __post_init__(self) -> None:
        _validate.choice("start", self.start, ("report", "half_kick"))

    def limit(self, spectrum: Spectrum) -> float:
        """Root of the top eigenvalue of M^-1 (h^2 K + 2 h Z) at 4 [s]."""
        return spectrum.largest_step(1.0, 2.0, 4.0)

    def bind(self, dtype: np.dtype[Any], timestep: float, spectrum: Spectrum) -> LeapfrogData:
        """Typed timesteps."""
        del spectrum
        data = LeapfrogData(dtype.type(timestep), dtype.type(0.5 * timestep), float(timestep))
        return data if self.start == "report" else VerletData(*data)
