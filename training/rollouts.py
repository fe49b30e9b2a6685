"""Episodes of a policy on chosen targets, and what they come to.

An episode succeeds at a tolerance if the distance to the target stays below it on each of the last steps that the goal counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy

from flag_env.envs.config import EPISODE_STEPS
from flag_env.tasks import HOLD, Goal

TOLERANCES = {"success_5": 0.05, "success_3": 0.03}
"""Name of a success rate -> distance that counts as reached, in flag diagonals."""


class Policy(Protocol):
    """What can be evaluated."""

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Prepare for episodes with these targets of the split, one per environment."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions of one step, a row for each environment."""


class Agent:
    """A trained model, or its policy alone, acting without exploration."""

    def __init__(self, model: BaseAlgorithm | BasePolicy) -> None:
        self._model = model

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Nothing to prepare."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Most likely actions."""
        return self._model.predict(observations, deterministic=True)[0]


def rollout(policy: Policy, envs: VectorEnv, targets: Sequence[int]) -> NDArray[np.float64]:
    """Distances after every step of one episode per target, shape (targets, steps); infinite after a divergence."""
    width = envs.num_envs
    rows = []
    for first in range(0, len(targets), width):
        chosen = np.resize(np.asarray(targets[first : first + width], np.int64), width)  # the last round is filled up
        distances = np.full((width, EPISODE_STEPS), np.inf)
        running = np.ones(width, bool)
        observations = begin(envs, chosen)
        policy.begin(chosen)
        for step in range(EPISODE_STEPS):
            observations, _, terminated, _, infos = envs.step(policy.act(observations))
            running &= ~terminated
            distances[running, step] = infos["distance"][running]
        rows.append(distances[: len(targets) - first])
    return np.concatenate(rows)


def begin(envs: VectorEnv, targets: NDArray[np.int64]) -> NDArray[np.float32]:
    """Start an episode of every environment, each with its own target, and return the observations."""
    observations: NDArray[np.float32]
    for copy, target in enumerate(targets):
        mask = np.arange(envs.num_envs) == copy
        observations, _ = envs.reset(options={"reset_mask": mask, "target": int(target)})
    return observations


def summary(distances: NDArray[np.float64], goal: Goal = HOLD) -> dict[str, float | None]:
    """Success rates at each tolerance and the median final distance (None: most diverged) of `rollout`'s distances.

    Where the target moves, also the share of the steps that count on which the distance was below 5 %.
    """
    worst = distances[:, -goal.steps :].max(axis=1)
    rates: dict[str, float | None] = {name: float((worst < tolerance).mean()) for name, tolerance in TOLERANCES.items()}
    median = float(np.median(distances[:, -1]))
    if goal.moving:
        rates["steps_5"] = float((distances[:, -goal.steps :] < TOLERANCES["success_5"]).mean())
    return rates | {"median_distance": median if np.isfinite(median) else None}
