"""What an agent sees of a batch of flags and is paid for: one view an environment id. All arrays lead with the copies."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from flag_env.envs.batch import LIMIT, FlagBatch
from flag_env.tasks import REWARDS

Numbers = Any  # float, or NDArray[np.float64]
Observation = Any
"""An array, or a dictionary of arrays."""


class FlatView:
    """One flat vector: nodes, velocities, targets, differences, actuators, time left; rewards by the whole flag's distance."""

    rewards: ClassVar[tuple[str, ...]] = tuple(REWARDS)

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

    def terms(self, before: Numbers, distance: Numbers, observation: Observation) -> dict[str, Numbers]:
        """Named terms that sum to the rewards, of all copies or, from numbers and its own observation, of one."""
        del observation
        return self._terms(before, distance, self._tolerance)


class GoalView(FlatView):
    """A dictionary with achieved and desired goal, the nodes' positions; rewards are a function of these two alone."""

    rewards: ClassVar[tuple[str, ...]] = ("sparse", "dense")

    def space(self) -> spaces.Space[Any]:
        """Space of one flag's observation."""
        nodes = 3 * len(self.batch.nodes)
        rest = _box(2 * nodes + self.batch.control.state_size + 1)
        return spaces.Dict({"observation": rest, "achieved_goal": _box(nodes), "desired_goal": _box(nodes)})

    def observe(self) -> Observation:
        """Observations of all copies, fresh memory."""
        return self._parts(self.batch.observed)

    def observation(self, copy: int) -> Observation:
        """One copy's of these."""
        return self._parts(self.batch.rows[copy])

    def _parts(self, whole: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Of flat observations (..., entries)."""
        n = 3 * len(self.batch.nodes)
        return {
            "observation": np.concatenate([whole[..., : 2 * n], whole[..., 4 * n :]], axis=-1),
            "achieved_goal": whole[..., :n].copy(),
            "desired_goal": whole[..., 2 * n : 3 * n].copy(),
        }

    def terms(self, before: Numbers, distance: Numbers, observation: Observation) -> dict[str, Numbers]:
        """Named terms that sum to the rewards; see `FlatView`."""
        del before, distance
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
    return spaces.Box(-LIMIT, LIMIT, (size,), np.float32)
