"""Wind and mast together: the entries of `WindControl`, then those of `MastControl`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env.control.base import Array, Control
from flag_env.control.mast import MastControl
from flag_env.control.wind import WindControl
from flag_env.physics import Gradient, Scene, Simulator


class BothControl(Control):
    """Sets the wind's amplitude and moves the mast. State: that of the wind, then that of the mast."""

    size: ClassVar[int] = WindControl.size + MastControl.size
    state_size: ClassVar[int] = WindControl.state_size + MastControl.state_size
    error_scale: ClassVar[float] = 0.1
    has_derivatives: ClassVar[bool] = True
    mast_range: ClassVar[float] = MastControl.mast_range
    mast_pose: ClassVar[slice | None] = slice(WindControl.state_size, WindControl.state_size + 5)

    def __init__(self, scene: Scene, copies: int) -> None:
        super().__init__(scene, copies)
        self._wind, self._mast = WindControl(scene, copies), MastControl(scene, copies)

    @classmethod
    def check(cls, scene: Scene) -> None:
        """Raise ValueError unless the scene has a wind and pinned particles."""
        WindControl.check(scene)
        MastControl.check(scene)

    def reset(self, simulator: Simulator, copies: NDArray[np.intp]) -> None:
        """No wind from the agent; mast upright, at the origin, at rest."""
        self._wind.reset(simulator, copies)
        self._mast.reset(simulator, copies)
        self.state[copies] = 0.0

    def apply(self, simulator: Simulator, actions: NDArray[np.floating[Any]]) -> bool:
        """Let the wind and the mast follow their set-points; see `Control.apply`."""
        if not np.isfinite(actions).all():
            return False
        rows = actions.reshape(len(self.state), self.size)
        self._wind.apply(simulator, rows[:, : WindControl.size])
        self._mast.apply(simulator, rows[:, WindControl.size :])
        np.concatenate([self._wind.state, self._mast.state], axis=1, out=self.state)
        return True

    @classmethod
    def drive(cls, scene: Scene, actions: Array) -> dict[str, Array]:
        """Those of the wind and of the mast; see `Control.drive`."""
        wind, mast = actions[..., : WindControl.size], actions[..., WindControl.size :]
        return WindControl.drive(scene, wind) | MastControl.drive(scene, mast)

    @classmethod
    def drive_back(cls, scene: Scene, actions: Array, gradient: Gradient) -> Array:
        """Back through both; see `Control.drive_back`."""
        wind, mast = actions[..., : WindControl.size], actions[..., WindControl.size :]
        parts = WindControl.drive_back(scene, wind, gradient), MastControl.drive_back(scene, mast, gradient)
        return np.concatenate(parts, axis=-1)

    def mast_share(self, pose: Array) -> Array:
        """Poses of masts (n, 5) in shares of the range."""
        return self._mast.mast_share(pose)

    def get_state(self, copy: int) -> tuple[Array, ...]:
        """Those of the wind, then those of the mast."""
        return *self._wind.get_state(copy), *self._mast.get_state(copy)

    def set_state(self, copy: int, state: tuple[Array, ...]) -> None:
        """Bring the wind and the mast to where `get_state` found them."""
        self._wind.set_state(copy, state[:1])
        self._mast.set_state(copy, state[1:])
        self.state[copy] = np.concatenate([self._wind.state[copy], self._mast.state[copy]])
