"""Policies that learn nothing: what an agent has to beat.

Each is made from a task and a split, and evaluated like an agent. `lookup` and `p_control` know more than an agent does: they are
told the whole target pose.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from flag_env.control import CONTROLS, MastControl
from flag_env.tasks import load_targets
from training.environments import Task
from training.rollouts import Policy

Actions = NDArray[np.float32]
Observations = NDArray[np.float32]


class Zero:
    """Never acts."""

    def __init__(self, task: Task, split: str) -> None:
        self._size = action_size(task)

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Count the environments."""
        self._shape = len(targets), self._size

    def act(self, observations: Observations) -> Actions:
        """No action."""
        return np.zeros(self._shape, np.float32)


class Random(Zero):
    """Acts at random, the same at every evaluation."""

    def __init__(self, task: Task, split: str) -> None:
        super().__init__(task, split)
        self._rng = np.random.default_rng(0)

    def act(self, observations: Observations) -> Actions:
        """Uniform over the action space."""
        return self._rng.uniform(-1, 1, self._shape).astype(np.float32)


class Lookup:
    """Replays the witness of the nearest training target (RMS over the particles), blind to the hidden wind."""

    def __init__(self, task: Task, split: str) -> None:
        self._train = load_targets(task.control, task.level, "train")
        poses = load_targets(task.control, task.level, split).positions
        self._nearest = cdist(_flat(poses), _flat(self._train.positions)).argmin(axis=1)

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Find the witnesses."""
        self._actions: Actions = np.stack([self._train.actions(self._nearest[target]) for target in targets], axis=1)
        self._step = 0

    def act(self, observations: Observations) -> Actions:
        """Next action of each witness."""
        self._step += 1
        now: Actions = self._actions[self._step - 1]
        return now


class PControl:
    """Steers the mast straight to the pose of the target's mast."""

    GAIN = 4.0
    """Wanted velocity / error of the pose [1/s]."""

    def __init__(self, task: Task, split: str) -> None:
        if task.control != "mast":
            raise ValueError(f"control must be 'mast' for the baseline p_control, got {task.control!r}")
        masts = load_targets(task.control, task.level, split).positions[:, 0, :, 0]
        self._poses = mast_pose(masts)

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Read off where the mast is to go."""
        self._goal = self._poses[targets]

    def act(self, observations: Observations) -> Actions:
        """Velocity towards the goal, foreseeing what the actuator's lag adds to it."""
        state = observations[:, -1 - 2 * len(MastControl.reach) : -1]  # the mast's pose and velocity, before the time left
        pose, velocity = np.split(state, 2, axis=1)
        error = self._goal - (pose * MastControl.reach + MastControl.lag * velocity * MastControl.speed)
        return np.clip(self.GAIN * error / MastControl.speed, -1, 1).astype(np.float32)


BASELINES: dict[str, Callable[[Task, str], Policy]] = {
    "zero": Zero,
    "random": Random,
    "lookup": Lookup,
    "p_control": PControl,
}


def action_size(task: Task) -> int:
    """Entries of an action."""
    return CONTROLS[task.control].size


def mast_pose(masts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement (x, y, z) [m] and tilt (about x, about y) [rad] of masts given by points from foot to top (n, points, 3)."""
    foot, axis = masts[:, 0], masts[:, -1] - masts[:, 0]
    # Ry(b) Rx(a) turns the vertical to (sin b cos a, -sin a, cos b cos a).
    length = np.linalg.norm(axis, axis=1)
    tilt = np.stack([np.arcsin(-axis[:, 1] / length), np.arctan2(axis[:, 0], axis[:, 2])], axis=1)
    return np.concatenate([foot, tilt], axis=1)


def _flat(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return poses.reshape(len(poses), -1)
