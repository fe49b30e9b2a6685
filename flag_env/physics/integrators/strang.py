"""Strang splitting: half a drift, a kick with implicit damping, half a drift.

    x_{n+1/2} = x_n + h v_n / 2
    M (v_{n+1} - v_n) = h F(x_{n+1/2}, (v_n + v_{n+1}) / 2, t_n + h / 2)
    x_{n+1} = x_{n+1/2} + h v_{n+1} / 2

The kick is linear in the velocity: Crank-Nicolson. Isotropic dampers and drag have a constant matrix Z, the same for every
coordinate, copy and pose; since the effects' own force at v_n holds their damping already, the kick is

    (M + h Z / 2) (v_{n+1} - v_n) = h F(x_{n+1/2}, v_n, t_n + h / 2),

one force evaluation and one solution with a constant banded factor (which costs about as much as the evaluation). Order 2,
reversible without damping, velocities at the instant of the positions. Axial dampers and a nonlinear drag are not Z, though never
more than it: one such kick stays stable but is of order 1 in their damping; with iterations=2 the kick is improved once, by a
second evaluation, and is of order 2 again.

Step limit: h w <= 2, the top eigenvalue of h^2 M^-1 K at 4, whatever the damping: v' M v / 2 + x_{n+1/2}' K x_{n-1/2} / 2 never
grows, and is positive below the limit, for any symmetric K, Z >= 0. Parameters: iterations.
Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Hairer, Lubich, Wanner, Geometric Numerical Integration, II.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flag_env import _validate
from flag_env.physics.compiling import forces, jit, pull_back
from flag_env.physics.integrators._linear_algebra import Factor, factorise, improve
from flag_env.physics.integrators._rows import accumulate, add, add_multiple, add_rows, copy_rows, scale
from flag_env.physics.integrators.base import Integrator, Spectrum


class StrangData(NamedTuple):
    """Timestep, half of it and one half in the scene's dtype; the timestep in float64 [s]; the factor of M + h Z / 2."""

    timestep: Any
    half: Any
    one_half: Any
    seconds: float
    iterations: int
    factor: Factor

    @staticmethod
    def rows() -> tuple[int, int]:
        """Rows of history and of work."""
        return 0, 3

    @staticmethod
    @jit
    def step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """Drift, kick, drift."""
        change, middle = integrator_work[0, : x.shape[0]], integrator_work[1, : x.shape[0]]
        change[:] = 0
        accumulate(x, v, method.half)
        for _ in range(method.iterations):
            add_multiple(middle, v, change, method.one_half)
            forces(effects, copy, x, middle, f, effect_work, 0.5 * method.seconds)
            improve(method.factor, change, f, integrator_work[2], method.timestep)
        copy_rows(middle, v)
        add(v, middle, change)
        accumulate(x, v, method.half)

    @staticmethod
    @jit
    def velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """They are at the instant of the positions as they are."""
        copy_rows(f, v)

    @staticmethod
    def back_rows() -> int:
        """Rows of work on the way back."""
        return 4

    @staticmethod
    @jit
    def step_back(method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag):
        """Undo drift, kick and drift: the kick's matrix is symmetric, and a viscosity acts on the mean velocity of the kick."""
        n = x.shape[0]
        g, middle, felt = work[0, :n], work[1, :n], work[2, :n]
        accumulate(dv, dx, method.half)
        g[:] = 0
        improve(method.factor, g, dv, work[3], method.timestep)
        add_multiple(middle, x, v, method.half)
        add(felt, v, after)
        scale(felt, method.one_half)
        pull_back(effects, slopes, copy, middle, v, felt, g, dx, dv, effect_work, lag + 0.5 * method.seconds)
        accumulate(dv, dx, method.half)

    @staticmethod
    @jit
    def velocity_back(
        method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
    ):  # fmt: skip
        """They are at the instant of the positions as they are."""
        add_rows(dv, after)


@dataclass(frozen=True)
class Strang(Integrator):
    """Drift, kick with implicit damping, drift: order 2, a step limit that damping does not lower.

    Parameters
    ----------
    iterations
        Evaluations of the force in a kick: 1, or 2 for order 2 with axial dampers or nonlinear drag too.
    """

    order: ClassVar[int] = 2
    undamped_share: ClassVar[float] = 0.5
    solves_damping: ClassVar[bool] = True

    iterations: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "iterations", _validate.count("iterations", self.iterations))

    @property
    def evaluations(self) -> int:
        """Evaluations of the forces in a step."""
        return self.iterations

    @property
    def solutions(self) -> int:
        """One to each evaluation."""
        return self.iterations

    def limit(self, spectrum: Spectrum) -> float:
        """Root of the top eigenvalue of h^2 M^-1 K at 4 [s]."""
        return spectrum.largest_step(1.0, 0.0, 4.0)

    def bind(self, dtype: np.dtype[Any], timestep: float, spectrum: Spectrum) -> StrangData:
        """Typed timesteps and the factorised matrix."""
        number, factor = dtype.type, factorise(spectrum, dtype, 0.5 * timestep, 0.0)
        return StrangData(number(timestep), number(0.5 * timestep), number(0.5), float(timestep), self.iterations, factor)
