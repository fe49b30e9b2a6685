"""Wind control: the agent sets the amplitude of the cosine wind.

The action is a set-point for u in [-1, 1]^3, which follows it with a lag of 0.2 s. Force on every free particle [N]:

    mean particle mass x (MEAN + hidden offset + GAIN u cos(phase)),   phase' = FREQUENCY

The frequencies are the report's. The hidden offset belongs to the episode, not to the control. Another wind is a subclass with
another `gain`, `frequency` or `lag`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env.control.base import Array, Control, clipped_share, hold, lag_factor
from flag_env.physics import Gradient, Scene, Simulator
from flag_env.physics.compiling import cached, entry_point

GAIN = np.array([6.0, 8.0, 5.0])
"""Wind acceleration at full action (x, y, z) [m/s^2]."""

FREQUENCY = np.array([0.04, 0.05, 0.35])
"""Angular frequency of the wind (x, y, z) [rad/s]."""

LAG = 0.2
"""Time constant of the actuator [s]."""

DRAG = 1.5
"""Rate [1/s] at which moving air that is given a velocity counts as an acceleration of the cloth."""


def wind_of(scene: Scene, acceleration: Array) -> Array:
    """A wind acceleration [m/s^2] in the unit of the scene's wind: a force on a mean particle, or a velocity of the air."""
    force = any(effect.wind_unit == "N" for effect in scene.effects)
    return acceleration * float(scene.lattice.masses.mean()) if force else acceleration / DRAG


def _follow(actions: Any, share: float, full: Any, u: Any, amplitude: Any) -> bool:
    """Move u (copies, 3) by this share of the way to the actions, clipped; the amplitude that it stands for, of `full` (3,).

    False, and nothing more, unless all actions are finite.
    """
    for action in actions.flat:
        if (action - action) != 0.0:
            return False
    for k, action in enumerate(actions.flat):
        copy, i = k // 3, k % 3
        u[copy, i] += share * (min(max(float(action), -1.0), 1.0) - u[copy, i])
        amplitude[copy, i] = full[i] * u[copy, i]
    return True


_CACHED_FOLLOW = cache(lambda: cached(_follow, frozenset({Path(__file__)})))


@cache
def _compiled_follow(dtype: np.dtype[Any], dimensions: int) -> Callable[..., bool]:
    """`_follow` for actions of this dtype, with any strides."""
    actions, rows = np.zeros((2,) * dimensions, dtype)[::-1], np.zeros((1, 3))
    return entry_point(_CACHED_FOLLOW(), (actions, 0.0, np.zeros(3), rows, rows))


class WindControl(Control):
    """Sets the wind's amplitude. State: u.

    Attributes
    ----------
    gain
        Wind acceleration at full action (x, y, z) [m/s^2].
    frequency
        Angular frequency of the wind (x, y, z) [rad/s].
    lag
        Time constant of the actuator [s].
    """

    size: ClassVar[int] = 3
    state_size: ClassVar[int] = 3
    error_scale: ClassVar[float] = 0.1
    has_derivatives: ClassVar[bool] = True
    gain: ClassVar[Array] = GAIN
    frequency: ClassVar[Array] = FREQUENCY
    lag: ClassVar[float] = LAG

    def __init__(self, scene: Scene, copies: int) -> None:
        super().__init__(scene, copies)
        self._amplitude, self._share = wind_of(scene, self.gain), lag_factor(self.lag)

    @classmethod
    def check(cls, scene: Scene) -> None:
        """Raise ValueError unless the scene has a wind."""
        units = {effect.wind_unit for effect in scene.effects if effect.wind_unit}
        if len(units) > 1:
            raise ValueError(f"scene must hold winds in one unit for control='wind', got winds in {' and '.join(sorted(units))}")
        if not units:
            kinds = ", ".join(type(effect).__name__ for effect in scene.effects) or "none"
            raise ValueError(f"scene must hold a wind, such as effects.CosineWind(), for control='wind'; its effects: {kinds}")

    def reset(self, simulator: Simulator, copies: NDArray[np.intp]) -> None:
        """No wind from the agent; the wind's frequency for the episode."""
        self.state[copies] = 0.0
        simulator.set_wind(frequency=self.frequency)

    def apply(self, simulator: Simulator, actions: NDArray[np.floating[Any]]) -> bool:
        """Let u follow the set-points and set the wind's amplitude; see `Control.apply`."""
        amplitudes = simulator.wind_amplitudes
        follow = _compiled_follow(actions.dtype, actions.ndim)
        finite = follow(actions, self._share, self._amplitude, self.state, amplitudes[0])
        if len(amplitudes) > 1:
            for other in amplitudes[1:]:
                other[:] = amplitudes[0]
        return finite

    @classmethod
    def drive(cls, scene: Scene, actions: Array) -> dict[str, Array]:
        """Amplitudes of the wind; see `Control.drive`."""
        u = np.zeros(actions.shape[1:])
        amplitudes = np.empty(actions.shape)
        for step, action in enumerate(np.clip(actions, -1.0, 1.0)):
            u = u + lag_factor(cls.lag) * (action - u)
            amplitudes[step] = wind_of(scene, cls.gain) * u
        return {"wind": amplitudes}

    @classmethod
    def drive_back(cls, scene: Scene, actions: Array, gradient: Gradient) -> Array:
        """Back through the lag; see `Control.drive_back`."""
        assert gradient.wind is not None
        share = lag_factor(cls.lag)
        by_u = np.zeros(actions.shape[1:])
        result = np.empty(actions.shape)
        for step in range(len(actions) - 1, -1, -1):
            by_u = by_u + wind_of(scene, cls.gain) * gradient.wind[step]
            result[step] = share * by_u
            by_u = (1.0 - share) * by_u
        return result * clipped_share(actions)

    @staticmethod
    def sample_witness(rng: np.random.Generator, steps: int) -> Array:
        """A gust of 0.6 s, then a steady wind; |u| <= 0.8, so that an agent has something in hand."""
        return hold(rng.uniform(-0.8, 0.8, (2, 3)), (15,), steps)

    @staticmethod
    def alternative_actions(actions: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """The steady wind from the start, and the opposite gust before it."""
        steady = np.broadcast_to(actions[-1], actions.shape)
        gust = np.any(actions != actions[-1], axis=1, keepdims=True)
        return steady, np.where(gust, -actions, steady)
