"""What an agent sees of a batch of flags and is paid for: one view an environment id. All arrays lead with the copies."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.envs.batch import FlagBatch
from flag_env.envs.config import FlagConfig
from flag_env.envs.observation import BOUND
from flag_env.tasks import REWARDS

Numbers = Any  # float, or NDArray[np.float64]
Flags = Any  # bool, or NDArray[np.bool_]
Observation = Any
"""An array, or a dictionary of arrays."""


class FlatView:
    """One flat vector: nodes, velocities, targets, differences, actuators, time left; rewards by the whole flag's distance."""

    rewards: ClassVar[tuple[str, ...]] = tuple(REWARDS)
    """Rewards that it can give."""

    @classmethod
    def reward_of(cls, config: FlagConfig) -> str:
        """Name of the reward; raise ValueError where this view cannot give the one asked for."""
        return config.task.reward if config.reward is None else _validate.choice("reward", config.reward, cls.rewards)

    def __init__(self, batch: FlagBatch, reward: str) -> None:
        self.batch, self._terms, self._tolerance = batch, REWARDS[reward], batch.config.tolerance
        self.no_terms: dict[str, float] = dict.fromkeys(self._terms(0.0, 0.0, self._tolerance), 0.0)

    def space(self) -> spaces.Space[Any]:
        """Space of one flag's observation."""
        return _box(self.batch.observed.shape[1])

    def observe(self) -> Observation:
        """Observations of all copies, fresh memory."""
        return self.batch.observed.copy()

    def observation(self, copy: int) -> Observation:
        """One copy's of these."""
        return self.batch.rows[copy].copy()

    def terms(self, before: Numbers, distance: Numbers, observation: Observation, last: Flags) -> dict[str, Numbers]:
        """Named terms that sum to the rewards, of all copies or, from numbers and its own observation, of one.

        `last` tells whether the step is the last of those that the targets were made for.
        """
        del observation
        return self._terms(before, distance, self._tolerance, last)


class GoalView(FlatView):
    """A dictionary with achieved and desired goal, the nodes' positions; rewards are a function of these two alone."""

    rewards: ClassVar[tuple[str, ...]] = ("sparse", "dense")

    def space(self) -> spaces.Space[Any]:
        """Space of one flag's observation."""
        parts = self._parts(self.batch.rows[0])
        return spaces.Dict({name: _box(len(part)) for name, part in parts.items()})

    def observe(self) -> Observation:
        """Observations of all copies, fresh memory."""
        return self._parts(self.batch.observed)

    def observation(self, copy: int) -> Observation:
        """One copy's of these."""
        return self._parts(self.batch.rows[copy])

    def _parts(self, whole: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Of flat observations (..., entries)."""
        at = self.batch.layout
        rest = (at.positions, at.velocities, at.actuators, at.time_left)
        return {
            "observation": np.concatenate([whole[..., part] for part in rest], axis=-1),
            "achieved_goal": whole[..., at.positions].copy(),
            "desired_goal": whole[..., at.targets].copy(),
        }

    @classmethod
    def reward_of(cls, config: FlagConfig) -> str:
        """Name of the reward; raise ValueError where the target is no pose, or the reward no function of two of them."""
        if config.task.goal.moving:
            raise ValueError(f"level must have a pose for its goal in an environment with goals, got {config.task.name!r}")
        return cls.rewards[0] if config.reward is None else _validate.choice("reward", config.reward, cls.rewards)

    def terms(self, before: Numbers, distance: Numbers, observation: Observation, last: Flags) -> dict[str, Numbers]:
        """Named terms that sum to the rewards; see `FlatView`."""
        del before, distance, last
        return self.goal_terms(observation["achieved_goal"], observation["desired_goal"])

    def goal_terms(self, achieved: NDArray[Any], desired: NDArray[Any]) -> dict[str, Numbers]:
        """Terms (...,) for goals (..., 3 nodes); one reduction in float64, so that every caller gets the same bits."""
        difference = np.asarray(achieved, np.float64) - np.asarray(desired, np.float64)
        square = np.einsum("...i,...i->...", difference, difference) / len(self.batch.nodes)
        distance = np.sqrt(square) / self.batch.diagonal
        if distance.ndim == 0:
            distance = distance.item()
        return self._terms(distance, distance, self._tolerance)


def goal_reward(view: GoalView, achieved_goal: NDArray[Any], desired_goal: NDArray[Any]) -> Any:
    """Reward of one pair of goals (a float) or of many (an array).

    Raises
    ------
    TypeError, ValueError
        Unless both goals are finite numbers (..., 3 nodes) of the same shape.
    """
    achieved, desired = np.asarray(achieved_goal), np.asarray(desired_goal)
    size = 3 * len(view.batch.nodes)
    for name, goal in (("achieved_goal", achieved), ("desired_goal", desired)):
        if goal.dtype.kind not in "iuf":
            raise TypeError(f"{name} must be an array of numbers, got dtype {goal.dtype}")
        if goal.shape[-1:] != (size,):
            raise ValueError(f"{name} must have the shape (..., {size}), got {goal.shape}")
        if not np.isfinite(goal).all():
            raise ValueError(f"{name} must be finite, got {goal[~np.isfinite(goal)][0]}")
    if achieved.shape != desired.shape:
        raise ValueError(f"desired_goal must have the shape of achieved_goal, {achieved.shape}, got {desired.shape}")
    reward = sum(view.goal_terms(achieved, desired).values())
    return float(reward) if np.ndim(reward) == 0 else reward


def _box(size: int) -> spaces.Box:
    return spaces.Box(-BOUND, BOUND, (size,), np.float32)
