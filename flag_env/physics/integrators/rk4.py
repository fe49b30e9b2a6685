"""The classical Runge-Kutta scheme of order 4, for y = (x, v), y' = (v, F(x, v, t) / m).

    y_{n+1} = y_n + h (k1 + 2 k2 + 2 k3 + k4) / 6,
    k1 = y'(y_n, t_n), k2 = y'(y_n + h k1 / 2, t_n + h / 2), k3 = y'(y_n + h k2 / 2, t_n + h / 2), k4 = y'(y_n + h k3, t_n + h)

Four force evaluations a step. Pinned particles feel no force, so their stages lie on their even motion.

Step limit: |1 + z + z^2/2 + z^3/6 + z^4/24| <= 1 at z = h L for both roots of L^2 + c L + w^2 = 0, in every pose, where w^2 is
anything from nothing to its bound. In the plane of a = h^2 w^2, b = h c, the edge of that set bulges from a = 8 without damping
to 8.76 at b = 0.84, sags past b = 1.89 and ends with a = 6.84 at b = 2.7853. Inside it lies whatever is below all `BULGE` and
one of `SAG`; less than 0.7 % of h is left between. An eigenvector's own w^2 and c are Rayleigh quotients of K and Z, so a top
eigenvalue for each line p a + q b = r puts every mode below it, whether the matrices share their modes or not. Where q < 0
damping earns a longer step, and only damping that acts along every direction in every pose is counted. Parameters: none.
Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flag_env.physics.compiling import forces, jit, kernel, pull_back
from flag_env.physics.integrators._rows import accumulate, add_multiple, add_rows, copy_rows
from flag_env.physics.integrators.base import Integrator, Spectrum, positive_root

BULGE = ((1.0, -1.258, 8.0), (1.0, 0.097, 8.735), (0.0, 1.0, 2.785293563405))
"""Lines p a + q b = r that bound the stable set where it bulges, and its end, as (p, q, r)."""

SAG = ((1.0, 1.4, 10.314), (1.0, 0.618, 8.482))
"""Lines, any of which bounds it where it sags."""


@kernel
def _accelerate(f, inverse_mass, n):
    for t in range(n):
        f[t] *= inverse_mass[t]


@kernel
def _stage_share(g, next_x, next_v, end_x, end_v, inverse_mass, share, reach, last, n):
    """From the derivatives by the step's end and by the next stage, those by a stage's slopes: of its velocities in `next_v`.

    `next_x` is cleared.
    """
    for t in range(n):
        by_speed = share * end_x[t] + (0 * reach if last else reach * next_x[t])
        by_force = share * end_v[t] + (0 * reach if last else reach * next_v[t])
        next_x[t] = 0
        next_v[t] = by_speed
        g[t] = inverse_mass[t] * by_force


@jit
def _slope(effects, copy, x, v, f, effect_work, inverse_mass, lag):
    """Leave the accelerations in `f`."""
    forces(effects, copy, x, v, f, effect_work, lag)
    for d in range(x.shape[0]):
        _accelerate(f[d], inverse_mass, x.shape[1])


class RK4Data(NamedTuple):
    """Timestep, its half, third and sixth in the scene's dtype; in float64 for the effects' own state [s]."""

    timestep: Any
    half: Any
    third: Any
    sixth: Any
    seconds: float

    @staticmethod
    def rows() -> tuple[int, int]:
        """Rows of history and of work."""
        return 0, 4

    @staticmethod
    @jit
    def step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """Four slopes, each added to the result as soon as the next stage is made."""
        n = x.shape[0]
        at, speed, x0, v0 = integrator_work[0, :n], integrator_work[1, :n], integrator_work[2, :n], integrator_work[3, :n]
        copy_rows(x0, x)
        copy_rows(v0, v)
        copy_rows(at, x)
        copy_rows(speed, v)
        for stage in range(4):
            _slope(effects, copy, at, speed, f, effect_work, inverse_mass, (0.0, 0.5, 0.5, 1.0)[stage] * method.seconds)
            share = method.third if stage == 1 or stage == 2 else method.sixth
            reach = method.timestep if stage == 2 else method.half
            accumulate(x, speed, share)
            accumulate(v, f, share)
            if stage < 3:
                add_multiple(at, x0, speed, reach)
                add_multiple(speed, v0, f, reach)

    @staticmethod
    @jit
    def velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """They are at the instant of the positions as they are."""
        copy_rows(f, v)

    @staticmethod
    def back_rows() -> int:
        """Rows of work on the way back."""
        return 13

    @staticmethod
    @jit
    def step_back(method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag):
        """Find the stages anew, then undo them from the last to the first."""
        n = x.shape[0]
        f = work[0, :n]
        copy_rows(work[1], x)
        copy_rows(work[5], v)
        for stage in range(3):
            at, speed = work[1 + stage, :n], work[5 + stage, :n]
            _slope(effects, copy, at, speed, f, effect_work, inverse_mass, lag + (0.0, 0.5, 0.5)[stage] * method.seconds)
            reach = method.timestep if stage == 2 else method.half
            add_multiple(work[2 + stage, :n], x, speed, reach)
            add_multiple(work[6 + stage, :n], v, f, reach)
        end_x, end_v, next_x, next_v, g = f, work[9, :n], work[10, :n], work[11, :n], work[12, :n]
        copy_rows(end_x, dx)
        copy_rows(end_v, dv)
        for back in range(4):
            stage = 3 - back
            share = method.third if stage == 1 or stage == 2 else method.sixth
            reach = method.timestep if stage == 2 else method.half
            for d in range(n):
                _stage_share(g[d], next_x[d], next_v[d], end_x[d], end_v[d], inverse_mass, share, reach, back == 0, x.shape[1])
            at, speed = work[1 + stage, :n], work[5 + stage, :n]
            # the adjoint of the slope of the positions is already that of the stage's velocities
            moment = lag + (0.0, 0.5, 0.5, 1.0)[stage] * method.seconds
            pull_back(effects, slopes, copy, at, speed, speed, g, next_x, next_v, effect_work, moment)
            add_rows(dx, next_x)
            add_rows(dv, next_v)

    @staticmethod
    @jit
    def velocity_back(
        method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
    ):  # fmt: skip
        """They are at the instant of the positions as they are."""
        add_rows(dv, after)


@dataclass(frozen=True)
class RK4(Integrator):
    """The classical Runge-Kutta scheme: four force evaluations a step, order 4."""

    order: ClassVar[int] = 4

    @property
    def evaluations(self) -> int:
        """Evaluations of the forces in a step."""
        return 4

    def limit(self, spectrum: Spectrum) -> float:
        """Largest h that keeps every mode below all lines of `BULGE` and one of `SAG` [s]."""
        stiff, damped = spectrum.guaranteed_step(1.0, 0.0, 1.0) ** -2, 1.0 / spectrum.guaranteed_step(0.0, 1.0, 1.0)

        def guess(line: tuple[float, float, float]) -> float:
            return positive_root(
                line[0] * stiff, line[1] * damped, line[2]
            )  # right if one mode is the fastest and the most damped

        limit, sag = math.inf, 0.0
        for line in sorted(BULGE, key=guess):  # who binds first spares the others
            limit = min(limit, spectrum.largest_step(*line, stop_above=limit))
        for line in sorted(SAG, key=guess, reverse=True):
            if sag < limit:
                sag = max(sag, spectrum.largest_step(*line, stop_above=limit, least=sag))
        return min(limit, sag)

    def bind(self, dtype: np.dtype[Any], timestep: float, spectrum: Spectrum) -> RK4Data:
        """Typed timesteps."""
        del spectrum
        number = dtype.type
        return RK4Data(number(timestep), number(timestep / 2), number(timestep / 3), number(timestep / 6), float(timestep))
