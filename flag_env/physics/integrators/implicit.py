"""Implicit midpoint rule, then BDF2, solved with one constant matrix: for timesteps far above the explicit limits.

With g = 2 - sqrt(2), c = g h / 2 and b = (sqrt(2) + 1) / 2, a step of y = (x, v), y' = (v, F(x, v, t) / m), is

    y_g = y_n + 2 c y'((y_n + y_g) / 2, t_n + c)                    midpoint rule over g h
    y_{n+1} = b y_g - (b - 1) y_n + c y'(y_{n+1}, t_n + h)          BDF2 over the rest

the scheme known as TR-BDF2 with its trapezoidal half exchanged for the midpoint rule, which saves an evaluation. Order 2,
L-stable, one step, so nothing is remembered; velocities are at the instant of the positions. Both halves ask for a change of
velocity d with M d = s F, where F is taken at velocities and positions linear in d, and s = 2 c or c. Both are solved by
improvements

    A d += s F - M d,    A = M + c Z + c^2 K,

the first half from d = 0, the second from the velocity of y_g. K and Z are the isotropic bounds that no pose exceeds. So A is
never below the true Jacobian: each improvement lowers the potential that the rule minimises (majorise and minimise, the local and
global steps of projective dynamics), without line search, and A is factorised once for both halves and every coordinate, copy and
pose. One improvement gives order 2 with isotropic dampers, two with axial dampers and nonlinear drag as well; more shrink the
error constant. They go on until one moves the velocities by less than a thousandth of their change: a fixed number rings between
two states at 8 to 15 explicit limits. To start the improvements from an extrapolated velocity instead breaks up at large steps.

Step limit: for the linear problem there is none, and even undamped and at 100 times the explicit limit a flag in gusts stays
whole. But thrown or crumpled cloth, whose links turn and buckle, gains energy there. The limit is where it was found to lose
energy: 10 times the explicit limit without damping, and wherever Z >= h K / 1000. At large steps a flag no longer flaps as it
should: fast modes are slowed and damped. timestep="auto" therefore ends at 2.7 times the explicit limit without damping.

Why this one. RMS error in mm of a flag of 16 x 10 particles after 1 s in gusts, with the number of force evaluations:

    this, 2 improvements        5.2 (800)    0.44 (1600)   0.036 (3200)
    TR-BDF2, 2 improvements     7.5 (800)    0.64 (1600)   0.051 (3200)
    BDF2, 2 improvements        11 (800)     0.94 (1600)
    midpoint, 3 improvements    6.3 (600)    0.41 (1200)   0.027 (2400), but stretches fivefold at 20 explicit limits
    projective dynamics, 3      68 (600)     4.3 (1200)    4.1 (2400): implicit Euler, order 1

On a similar flag, linearly implicit Euler and BDF2 with the true Jacobian were off by 180 mm and 4 mm after 50 and 200
factorisations of a matrix three times as wide, and position-based dynamics (XPBD) by 6 mm after 4000 evaluations.

Parameters: iterations. Sources: Bank et al., IEEE Trans. Computer-Aided Design 4 (1985) 436 (TR-BDF2); Bouaziz et al., ACM Trans.
Graph. 33 (2014) 154 (projective dynamics); Hunter and Lange, The American Statistician 58 (2004) 30 (majorise and minimise).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flag_env import _validate
from flag_env.physics.compiling import forces, jit
from flag_env.physics.integrators._linear_algebra import Factor, factorise, improve, is_settled
from flag_env.physics.integrators._rows import accumulate, add, add_multiple, copy_rows, scale
from flag_env.physics.integrators.base import DAMPED, Integrator, Spectrum

GAMMA = 2.0 - math.sqrt(2.0)
"""Share of the step that the midpoint rule takes: with it both halves have the same matrix."""

AHEAD = (math.sqrt(2.0) + 1.0) / 2.0
"""The b of BDF2."""


SETTLED = 1e-3
"""Share of the change of velocity that an improvement must move by less for a half to count as solved."""

LARGEST = 10.0
"""Explicit limits up to which violent motion of undamped cloth was found to lose energy; at 20 it gained."""

STILL = 1e-8
"""Speed [m/s] by less than which an improvement may move the particles of cloth that hardly moves at all."""

MOST = 200
"""Improvements in a half at most: cloth that is crumpled at a large step settles in tens."""


class ImplicitData(NamedTuple):
    """Numbers in the scene's dtype, unless said otherwise.

    Attributes
    ----------
    reach, twice
        c and 2 c [s].
    half
        1/2.
    ahead, back
        b and 1 - b.
    drift, turn
        2 b c and b c [s].
    seconds
        Timestep in float64 [s].
    iterations
        Improvements in each half.
    factor
        Of A.
    """

    reach: Any
    twice: Any
    half: Any
    ahead: Any
    back: Any
    drift: Any
    turn: Any
    seconds: float
    iterations: int
    factor: Factor

    @staticmethod
    def rows() -> tuple[int, int]:
        """Rows of history and of work."""
        return 0, 4

    @staticmethod
    @jit
    def step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """Both halves; from the end of the first on, `x` and `v` hold the known part of the second."""
        n = x.shape[0]
        change, speed, place = integrator_work[0, :n], integrator_work[1, :n], integrator_work[2, :n]
        change[:] = 0
        for turn in range(MOST):
            add_multiple(speed, v, change, method.half)
            add_multiple(place, x, speed, method.reach)
            forces(effects, copy, place, speed, f, effect_work, (0.5 * GAMMA) * method.seconds)
            improve(method.factor, change, f, integrator_work[3], method.twice)
            if turn + 1 >= method.iterations and is_settled(method.factor, change, integrator_work[3], SETTLED, STILL):
                break
        accumulate(x, v, method.drift)
        accumulate(x, change, method.turn)
        accumulate(v, change, method.ahead)
        scale(change, method.back)
        for turn in range(MOST):
            add(speed, v, change)
            add_multiple(place, x, speed, method.reach)
            forces(effects, copy, place, speed, f, effect_work, method.seconds)
            improve(method.factor, change, f, integrator_work[3], method.reach)
            if turn + 1 >= method.iterations and is_settled(method.factor, change, integrator_work[3], SETTLED, STILL):
                break
        copy_rows(speed, v)
        add(v, speed, change)
        accumulate(x, v, method.reach)

    @staticmethod
    @jit
    def velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
        """They are at the instant of the positions as they are."""
        copy_rows(f, v)


@dataclass(frozen=True)
class Implicit(Integrator):
    """Midpoint rule and BDF2 with a constant matrix: order 2, L-stable, for steps far above the explicit limits.

    Parameters
    ----------
    iterations
        Improvements in each half of a step at least, >= 1; each takes a force evaluation and a solution with the banded factor.
        More follow until a half has settled.
    """

    order: ClassVar[int] = 2

    iterations: int = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "iterations", _validate.count("iterations", self.iterations))

    @property
    def evaluations(self) -> int:
        """Evaluations of the forces in a step."""
        return 2 * self.iterations

    @property
    def solutions(self) -> int:
        """One to each evaluation."""
        return 2 * self.iterations

    def limit(self, spectrum: Spectrum) -> float:
        """Ten times the explicit limit without damping, or as far as the stiffness is damped, if that is further [s]."""
        return max(LARGEST * spectrum.largest_step(1.0, 0.0, 4.0), spectrum.damped_step() / DAMPED)

    def useful(self, spectrum: Spectrum) -> float:
        """Three times the explicit limit without damping: there it is as accurate as `Leapfrog` at its own limit [s]."""
        return 3.0 * spectrum.largest_step(1.0, 0.0, 4.0)

    def bind(self, dtype: np.dtype[Any], timestep: float, spectrum: Spectrum) -> ImplicitData:
        """Typed constants and the factorised matrix."""
        c = 0.5 * GAMMA * timestep
        number = dtype.type
        return ImplicitData(
            number(c),
            number(2.0 * c),
            number(0.5),
            number(AHEAD),
            number(1.0 - AHEAD),
            number(2.0 * AHEAD * c),
            number(AHEAD * c),
            float(timestep),
            self.iterations,
            factorise(spectrum, dtype, c, c * c),
        )
