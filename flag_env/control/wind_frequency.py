"""Wind control with a frequency: the agent sets amplitude and angular frequency of the cosine wind.

The first three entries are those of `WindControl`. The other three are set-points of the frequencies, -1 for none and 1 for
`fastest`, which follow with the same lag from the report's values; the phase goes on without a jump.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env.control.base import Array
from flag_env.control.wind import FREQUENCY, WindControl
from flag_env.physics import Simulator


class WindFrequencyControl(WindControl):
    """Sets the wind's amplitude and frequency. State: u, then the frequencies / `fastest`.

    Attributes
    ----------
    fastest
        Largest angular frequency (x, y, z) [rad/s].
    """

    size: ClassVar[int] = 6
    state_size: ClassVar[int] = 6
    has_derivatives: ClassVar[bool] = False  # a rollout has none by frequencies
    fastest: ClassVar[Array] = np.full(3, 6.0)

    def reset(self, simulator: Simulator, copies: NDArray[np.intp]) -> None:
        """No wind from the agent, at the report's frequencies."""
        self.state[copies, :3], self.state[copies, 3:] = 0.0, FREQUENCY / self.fastest
        self._set(simulator)

    def apply(self, simulator: Simulator, actions: NDArray[np.floating[Any]]) -> bool:
        """Let amplitude and frequency follow the set-points; see `Control.apply`."""
        if not np.isfinite(actions).all():
            return False
        wanted = np.clip(actions, -1.0, 1.0, dtype=np.float64).reshape(self.state.shape)
        wanted[:, 3:] = 0.5 * (wanted[:, 3:] + 1.0)
        self.state += self._share * (wanted - self.state)
        self._set(simulator)
        return True

    def _set(self, simulator: Simulator) -> None:
        simulator.set_wind(amplitude=self._amplitude * self.state[:, :3], frequency=self.fastest * self.state[:, 3:])

    @staticmethod
    def sample_witness(rng: np.random.Generator, steps: int) -> Array:
        """A gust of 0.6 s, then a steady wind of the least frequency."""
        amplitudes = WindControl.sample_witness(rng, steps)
        return np.concatenate([amplitudes, np.full_like(amplitudes, -1.0)], axis=1)

    @staticmethod
    def alternative_actions(actions: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """As of the wind's amplitude, at the same frequencies."""
        others = WindControl.alternative_actions(actions[:, :3])
        return tuple(np.concatenate([other, actions[:, 3:]], axis=1) for other in others)
