"""Mast control: the agent moves and tilts the mast.

The action sets velocities (x, y, z) and tilt rates (about x, about y), which follow it with a lag of 0.1 s. The mast's foot stays
inside a box, its tilt inside a range, both about the place of the start; at their edge the motion stops.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env.control.base import CONTROL_STEP, Array, Control, hold, lag_factor
from flag_env.physics import Scene, Simulator

SPEED = np.array([1.5, 1.5, 1.5, 1.0, 1.0])
"""Velocity at full action: x, y, z [m/s], about x, about y [rad/s]."""

REACH = np.array([1.0, 1.0, 1.0, 0.6, 0.6])
"""Largest displacement either way: x, y, z [m], about x, about y [rad]."""

LAG = 0.1
"""Time constant of the actuator [s]."""


class MastControl(Control):
    """Moves the pinned particles. State: pose / REACH, velocity / SPEED."""

    size: ClassVar[int] = 5
    state_size: ClassVar[int] = 10
    error_scale: ClassVar[float] = 0.5
    lag: ClassVar[float] = LAG
    reach: ClassVar[Array] = REACH
    speed: ClassVar[Array] = SPEED

    def __init__(self, scene: Scene, copies: int) -> None:
        super().__init__(scene, copies)
        self._pose = np.zeros((copies, 5))
        self._velocity = np.zeros((copies, 5))

    @classmethod
    def check(cls, scene: Scene) -> None:
        """Raise ValueError unless the scene has pinned particles."""
        if not scene.lattice.fixed.any():
            raise ValueError(f"scene must pin particles to a mast for control='mast', got pinned={scene.lattice.pinned!r}")

    def reset(self, simulator: Simulator, copies: NDArray[np.intp]) -> None:
        """Mast upright, at the origin, at rest."""
        del simulator
        self._pose[copies] = 0.0
        self._velocity[copies] = 0.0
        self.state[copies] = 0.0

    def apply(self, simulator: Simulator, actions: NDArray[np.floating[Any]]) -> bool:
        """Let the velocities follow the set-points and say where the mast is to be in the end; see `Control.apply`."""
        if not np.isfinite(actions).all():
            return False
        actions = np.clip(actions, -1.0, 1.0, dtype=np.float64).reshape(self._pose.shape)
        self._velocity += lag_factor(LAG) * (SPEED * actions - self._velocity)
        goal = np.clip(self._pose + CONTROL_STEP * self._velocity, -REACH, REACH)
        self._velocity = (goal - self._pose) / CONTROL_STEP
        self._pose = goal
        simulator.set_mast(position=goal[:, :3], tilt=goal[:, 3:])
        self.state[:, :5], self.state[:, 5:] = self._pose / REACH, self._velocity / SPEED
        return True

    @staticmethod
    def sample_witness(rng: np.random.Generator, steps: int) -> Array:
        """Two strokes of 0.6 s, then rest."""
        return hold(np.vstack([rng.uniform(-0.6, 0.6, (2, 5)), np.zeros(5)]), (15, 15), steps)

    @staticmethod
    def alternative_actions(actions: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """The straight way: the mean of the strokes for as long as they last."""
        moving = np.any(actions != 0, axis=1)
        return (np.where(moving[:, None], actions[moving].mean(axis=0), 0.0),)
