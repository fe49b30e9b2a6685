"""Policies that learn nothing: what an agent has to beat.

Each is made from a task and a split, and evaluated like an agent. `lookup` and `p_control` know more than an agent does: they are
told the whole target pose.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flag_env.control import MastControl, mast_pose
from training.environments import Task
from training.planner import Planner
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


class Witness:
    """Replays the witness of the target itself: the proof that it can be reached, not a policy."""

    def __init__(self, task: Task, split: str) -> None:
        self._library = task.targets(split)

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Find the witnesses."""
        self._actions: Actions = np.stack([self._library.actions(int(target)) for target in targets], axis=1)
        self._step = 0

    def act(self, observations: Observations) -> Actions:
        """Next action of each witness."""
        self._step += 1
        now: Actions = self._actions[self._step - 1]
        return now


class Lookup(Witness):
    """Replays the witness of the nearest training target (RMS over the steps that count), blind to the hidden wind.

    Parameters
    ----------
    task, split
        What is to be done, and where the targets are from.
    rank
        0 for the nearest, 1 for the next.
    """

    def __init__(self, task: Task, split: str, rank: int = 0) -> None:
        self._library = task.targets("train")
        near = neighbours(task, split, rank + 1 + (split == "train"))[0]
        self._nearest = np.arange(len(near)) if split == "train" and rank == 0 else near[:, rank + (split == "train")]

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Find the witnesses."""
        super().begin(self._nearest[targets])


def neighbours(task: Task, split: str, count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The nearest training targets of each target of a split, and their RMS distances in flag diagonals, (targets, count)."""
    train, these = (np.asarray(_judged(task, one), np.float32) for one in ("train", split))
    square = np.maximum((these**2).sum(axis=1)[:, None] + (train**2).sum(axis=1) - 2.0 * these @ train.T, 0.0)
    near = np.argsort(square, axis=1, kind="stable")[:, :count]
    distance = np.sqrt(np.take_along_axis(square, near, axis=1) / (train.shape[1] / 3)) / task.diagonal
    return near, distance.astype(np.float64)


def _judged(task: Task, split: str) -> NDArray[np.float64]:
    """Frames of a split on the steps that count, a row for each target."""
    frames = task.frames(split)
    return frames[:, -task.goal.steps :].reshape(len(frames), -1)


class PControl:
    """Steers the mast straight to the pose of the target's mast, and leaves the wind alone."""

    GAIN = 4.0
    """Wanted velocity / error of the pose [1/s]."""

    def __init__(self, task: Task, split: str) -> None:
        self._control = task.control_type
        at = self._control.mast_pose
        if at is None:
            raise ValueError(f"control must be 'mast' or 'both' for the baseline p_control, got {task.control!r}")
        self._mast = self._control if issubclass(self._control, MastControl) else MastControl
        self._first, self._state = self._control.size - 5, task.layout.actuators
        self._pose, self._velocity = at, slice(at.stop, at.stop + 5)
        frames = task.frames(split)
        masts = frames.reshape(*frames.shape[:2], *task.shape, 3)[:, :, 0, :, 0]
        self._poses = mast_pose(masts.reshape(-1, *masts.shape[2:])).reshape(*masts.shape[:2], 5)

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Read off where the mast is to go."""
        self._goal, self._step = self._poses[targets], 0

    def act(self, observations: Observations) -> Actions:
        """Velocity towards the goal, foreseeing what the actuator's lag adds to it."""
        goal = self._goal[:, min(self._step, self._goal.shape[1] - 1)]
        self._step += 1
        state, mast = observations[:, self._state], self._mast
        foreseen = state[:, self._pose] * mast.reach + mast.lag * state[:, self._velocity] * mast.speed
        actions = np.zeros((len(observations), self._control.size), np.float32)
        actions[:, self._first :] = np.clip(self.GAIN * (goal - foreseen) / mast.speed, -1, 1)
        return actions


BASELINES: dict[str, Callable[[Task, str], Policy]] = {
    "zero": Zero,
    "random": Random,
    "lookup": Lookup,
    "p_control": PControl,
    "witness": Witness,
    "planner": Planner,
    "planner_blind": partial(Planner, blind=True),
}


def action_size(task: Task) -> int:
    """Entries of an action."""
    return task.control_type.size
