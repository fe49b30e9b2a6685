"""Plans the actions of an episode with the cross-entropy method, in a simulator of its own.

A plan is a set-point every five steps, joined by straight lines. Many plans are drawn from a normal distribution, all are tried
from the start at once, and mean and spread of the best eighth make the next distribution (de Boer et al. 2005).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flag_env.control import wind_of
from flag_env.envs.batch import FlagBatch
from flag_env.envs.config import EPISODE_STEPS, WIND, FlagConfig
from training.environments import Task

KNOTS = 16
LEAST_SPREAD = 0.02


class Planner:
    """Acts as planned before the episode, without a look at the flag.

    Parameters
    ----------
    task, split
        What is to be done, and where the targets are from.
    blind
        Whether the planner knows nothing of the hidden wind and of the turbulence, and plans as if there were none of the one and
        some other of the other.
    samples, iterations
        Plans of one iteration, and how many there are.
    """

    def __init__(self, task: Task, split: str, blind: bool = False, samples: int = 64, iterations: int = 30) -> None:
        self._batch = FlagBatch(FlagConfig(task.control, task.level, split, accuracy=task.accuracy), samples)
        self._blind, self._iterations = blind, iterations
        self._size = self._batch.control.size
        times = np.linspace(0.0, KNOTS - 1.0, EPISODE_STEPS)
        low = np.minimum(times.astype(int), KNOTS - 2)
        self._joined = np.zeros((EPISODE_STEPS, KNOTS))
        self._joined[np.arange(EPISODE_STEPS), low] = 1.0 - (times - low)
        self._joined[np.arange(EPISODE_STEPS), low + 1] += times - low
        self._plans: dict[int, NDArray[np.float32]] = {}

    def begin(self, targets: NDArray[np.int64]) -> None:
        """Plan for each target."""
        for target in {int(target) for target in targets} - self._plans.keys():
            self._plans[target] = self.plan(target)
        self._actions = np.stack([self._plans[int(target)] for target in targets], axis=1)
        self._step = 0

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Next action of each plan."""
        self._step += 1
        now: NDArray[np.float32] = self._actions[self._step - 1]
        return now

    def plan(self, target: int) -> NDArray[np.float32]:
        """The best actions found for a target, (75, size); the same at every call."""
        rng, samples = np.random.default_rng(target), self._batch.copies
        mean, spread = np.zeros((KNOTS, self._size)), np.full((KNOTS, self._size), 0.6)
        best, least = mean, np.inf
        for _ in range(self._iterations):
            plans = np.clip(mean + spread * rng.standard_normal((samples, KNOTS, self._size)), -1.0, 1.0)
            plans[0], plans[1] = mean, best
            costs = self._costs(target, plans)
            elite = plans[np.argsort(costs)[: samples // 8]]
            if costs.min() < least:
                best, least = plans[costs.argmin()].copy(), float(costs.min())
            mean, spread = 0.1 * mean + 0.9 * elite.mean(axis=0), np.maximum(elite.std(axis=0), LEAST_SPREAD)
        return (self._joined @ best).astype(np.float32)

    def _costs(self, target: int, plans: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean and largest distance over the steps that count; more than any for plans that the simulation does not survive."""
        batch, goal = self._batch, self._batch.goal
        copies = range(batch.copies)
        batch.reset(copies, [target] * len(copies))
        if self._blind:
            if batch.simulator.wind() is not None:
                batch.simulator.set_wind(mean=wind_of(batch.scene, WIND))
            if batch.simulator.turbulent:
                batch.simulator.reseed(list(copies), list(copies))
        actions = np.einsum("tk,nkd->tnd", self._joined, plans)
        distances, lost = np.zeros((EPISODE_STEPS, len(copies))), np.zeros(len(copies), bool)
        for step in range(EPISODE_STEPS):
            batch.step(actions[step].astype(np.float32), actions[step].shape)
            distances[step], lost = batch.distance, lost | batch.diverged
        judged = distances[-goal.steps :]
        return np.where(lost, np.inf, judged.mean(axis=0) + judged.max(axis=0))
