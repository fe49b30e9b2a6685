"""Mast control: the agent moves and tilts the mast.

The action sets velocities (x, y, z) and tilt rates (about x, about y), which follow it with a lag of 0.1 s. The mast's foot stays
inside a box, its tilt inside a range, both about the place of the start; at their edge the motion stops. Another mast is a
subclass with another `speed`, `reach` or `lag`.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env.control.base import CONTROL_STEP, Array, Control, clipped_share, hold, lag_factor
from flag_env.physics import Gradient, Scene, Simulator

SPEED = np.array([1.5, 1.5, 1.5, 1.0, 1.0])
"""Velocity at full action: x, y, z [m/s], about x, about y [rad/s]."""

REACH = np.array([1.0, 1.0, 1.0, 0.6, 0.6])
"""Largest displacement either way: x, y, z [m], about x, about y [rad]."""

LAG = 0.1
"""Time constant of the actuator [s]."""


def _poses(control: type[MastControl], actions: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Poses after each step from rest on, (steps, copies, size), and whether they stay off their stops."""
    velocity, pose = np.zeros((2, *actions.shape[1:]))
    poses, inside = np.empty(actions.shape), np.empty(actions.shape, bool)
    for step, action in enumerate(np.clip(actions, -1.0, 1.0)):
        velocity = velocity + lag_factor(control.lag) * (control.speed * action - velocity)
        free = pose + CONTROL_STEP * velocity
        goal = np.clip(free, -control.reach, control.reach)
        velocity, pose = (goal - pose) / CONTROL_STEP, goal
        poses[step], inside[step] = goal, np.abs(free) <= control.reach
    return poses, inside


class MastControl(Control):
    """Moves the pinned particles. State: pose / reach, velocity / speed.

    Attributes
    ----------
    speed
        Velocity at full action: x, y, z [m/s], about x, about y [rad/s].
    reach
        Largest displacement either way: x, y, z [m], about x, about y [rad].
    lag
        Time constant of the actuator [s].
    """

    size: ClassVar[int] = 5
    state_size: ClassVar[int] = 10
    error_scale: ClassVar[float] = 0.5
    has_derivatives: ClassVar[bool] = True
    mast_range: ClassVar[float] = float(REACH[:3].max())
    mast_pose: ClassVar[slice | None] = slice(0, 5)
    lag: ClassVar[float] = LAG
    reach: ClassVar[Array] = REACH
    speed: ClassVar[Array] = SPEED

    def __init__(self, scene: Scene, copies: int) -> None:
        super().__init__(scene, copies)
        self._share = lag_factor(self.lag)
        self._pose = np.zeros((copies, self.size))
        self._velocity = np.zeros((copies, self.size))

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
        self._velocity += self._share * (self.speed * actions - self._velocity)
        goal = np.clip(self._pose + CONTROL_STEP * self._velocity, -self.reach, self.reach)
        self._velocity = (goal - self._pose) / CONTROL_STEP
        self._pose = goal
        simulator.set_mast(position=goal[:, :3], tilt=goal[:, 3:5], yaw=goal[:, 5] if self.size > 5 else 0.0)
        self.state[:, : self.size], self.state[:, self.size :] = self._pose / self.reach, self._velocity / self.speed
        return True

    def mast_share(self, pose: Array) -> Array:
        """Poses of masts (n, 5) in shares of the range."""
        return pose / self.reach[:5]

    def get_state(self, copy: int) -> tuple[Array, ...]:
        """Pose and velocity of one copy's mast, as they are."""
        return self._pose[copy].copy(), self._velocity[copy].copy(), *super().get_state(copy)

    def set_state(self, copy: int, state: tuple[Array, ...]) -> None:
        """Bring one copy's mast to where `get_state` found it."""
        self._pose[copy], self._velocity[copy], *rest = state
        super().set_state(copy, tuple(rest))

    @classmethod
    def drive(cls, scene: Scene, actions: Array) -> dict[str, Array]:
        """Poses of the mast; see `Control.drive`."""
        del scene
        return {"mast": _poses(cls, actions)[0]}

    @classmethod
    def drive_back(cls, scene: Scene, actions: Array, gradient: Gradient) -> Array:
        """Back through stops and lag; see `Control.drive_back`."""
        del scene
        assert gradient.mast is not None
        inside, share = _poses(cls, actions)[1], lag_factor(cls.lag)
        by_pose, by_velocity = np.zeros((2, *actions.shape[1:]))
        result = np.empty(actions.shape)
        for step in range(len(actions) - 1, -1, -1):
            pull = by_velocity / CONTROL_STEP
            by_goal = inside[step] * (by_pose + gradient.mast[step] + pull)
            result[step] = share * cls.speed * CONTROL_STEP * by_goal
            by_velocity = (1.0 - share) * CONTROL_STEP * by_goal
            by_pose = by_goal - pull
        return result * clipped_share(actions)

    @staticmethod
    def sample_witness(rng: np.random.Generator, steps: int) -> Array:
        """Two strokes of 0.6 s, then rest."""
        return hold(np.vstack([rng.uniform(-0.6, 0.6, (2, 5)), np.zeros(5)]), (15, 15), steps)

    @staticmethod
    def alternative_actions(actions: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """The straight way: the mean of the strokes for as long as they last."""
        moving = np.any(actions != 0, axis=1)
        return (np.where(moving[:, None], actions[moving].mean(axis=0), 0.0),)


class MastYawControl(MastControl):
    """Turns the mast about its own axis too (sixth entry): 2 rad/s at full action, within +-1 rad; needs a sleeve."""

    size: ClassVar[int] = 6
    state_size: ClassVar[int] = 12
    reach: ClassVar[Array] = np.append(REACH, 1.0)
    speed: ClassVar[Array] = np.append(SPEED, 2.0)

    @classmethod
    def check(cls, scene: Scene) -> None:
        """Raise ValueError unless a sleeve holds the cloth, which a turn of the mast then turns too."""
        if scene.lattice.pinned != "sleeve":
            raise ValueError(f"scene must be pinned by a sleeve for control='mast+yaw', got pinned={scene.lattice.pinned!r}")

    @staticmethod
    def sample_witness(rng: np.random.Generator, steps: int) -> Array:
        """Two strokes of 0.6 s, then rest."""
        return hold(np.vstack([rng.uniform(-0.6, 0.6, (2, 6)), np.zeros(6)]), (15, 15), steps)


def mast_pose(masts: Array) -> Array:
    """Displacement (x, y, z) [m] and tilt (about x, about y) [rad] of masts given by points from foot to top (n, points, 3)."""
    foot, axis = masts[:, 0], masts[:, -1] - masts[:, 0]
    # Ry(b) Rx(a) turns the vertical to (sin b cos a, -sin a, cos b cos a).
    length = np.linalg.norm(axis, axis=1)
    tilt = np.stack([np.arcsin(-axis[:, 1] / length), np.arctan2(axis[:, 0], axis[:, 2])], axis=1)
    return np.concatenate([foot, tilt], axis=1)
