"""Planners that know the simulator, the target and its hidden wind: by gradients, and by cross-entropy for comparison."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from flag_env.envs.config import FlagConfig
from flag_env.envs.derivative import DifferentiableEpisodes
from flag_env.tasks import HOLD

Array = NDArray[np.float64]

STARTS = 12
"""Action sequences that a plan may start from: no action, and random ones of the kind that makes targets."""

ELITES = 8
"""Best samples that the cross-entropy method goes on from."""

_MARGIN = 0.9
"""Share of the goal at which a plan stops: a float32 episode repeats exactly, so this only keeps it off the edge."""


class Plan(NamedTuple):
    """Actions found.

    Attributes
    ----------
    actions : (steps, size)
        In [-1, 1].
    distance
        Largest distance to the target over the steps that an episode is judged by, in flag diagonals.
    seconds, evaluations
        What it took: processor time of this process [s], and episodes run, with or without a gradient.
    """

    actions: Array
    distance: float
    seconds: float
    evaluations: int


class _Budget:
    """The best plan so far, and whether to go on."""

    def __init__(self, goal: float, seconds: float) -> None:
        self._goal, self._begun, self._seconds = goal, time.process_time(), seconds
        self._best: tuple[float, Array] = (np.inf, np.zeros((0, 0)))
        self._evaluations = 0

    def note(self, actions: Array, distances: Array) -> None:
        """Keep the best of episodes (steps, copies, size) with distances (steps, copies)."""
        worst = distances[-HOLD.steps :].max(axis=0)
        self._evaluations += len(worst)
        best = int(np.argmin(worst))
        if worst[best] < self._best[0]:
            self._best = float(worst[best]), actions[:, best].copy()

    @property
    def spent(self) -> bool:
        """Whether the goal is reached or the time over."""
        return self._best[0] < _MARGIN * self._goal or time.process_time() - self._begun > self._seconds

    @property
    def plan(self) -> Plan:
        """What has been found."""
        return Plan(self._best[1], self._best[0], time.process_time() - self._begun, self._evaluations)


class Planner:
    """Plans episodes of one task, one target after the other, each until the goal is reached or its time is over.

    Parameters
    ----------
    config
        The task.
    goal
        Distance to be within on the last steps, in flag diagonals.
    seconds
        Processor time for a target [s]; a method stops after the episode in which it ends.
    threads
        As for `Simulator`.
    """

    def __init__(self, config: FlagConfig, goal: float = 0.03, seconds: float = 0.5, threads: int | None = 1) -> None:
        self._control = config.control_type
        self._goal, self._seconds = goal, seconds
        self._one, self._many = DifferentiableEpisodes(config, 1, threads), DifferentiableEpisodes(config, STARTS, threads)
        for episodes in (self._one, self._many):  # compiled before the clock runs
            episodes.pull_back(np.ones_like(episodes.run(np.zeros(episodes.shape))))

    def by_gradient(self, target: int, seed: int = 0) -> Plan:
        """L-BFGS within the bounds of actions, from the nearest of all starts; then from the next nearest."""
        budget, rng = _Budget(self._goal, self._seconds), np.random.default_rng((seed, target))
        self._one.begin([target])
        self._many.begin([target] * STARTS)
        steps, _, size = self._one.shape
        starts = np.stack(
            [np.zeros((steps, size)), *(self._control.sample_witness(rng, steps) for _ in range(STARTS - 1))], axis=1
        )
        distances = self._many.run(starts)
        budget.note(starts, distances)
        for start in np.argsort((distances[-HOLD.steps :] ** 2).mean(axis=0)):
            if budget.spent:
                break
            scipy.optimize.minimize(  # type: ignore[call-overload]
                self._loss(budget), starts[:, start].ravel(), jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * (steps * size),
                callback=_stop(budget), options={"maxiter": 60, "maxcor": 20},
            )  # fmt: skip
        return budget.plan

    def by_cross_entropy(self, target: int, seed: int = 0) -> Plan:
        """Actions held for five steps each, drawn from normal distributions that are fitted to the best (Rubinstein 1999)."""
        budget, rng = _Budget(self._goal, self._seconds), np.random.default_rng((seed, target))
        self._many.begin([target] * STARTS)
        steps, _, size = self._many.shape
        held = 5
        mean, spread = np.zeros((steps // held, size)), np.full((steps // held, size), 0.5)
        samples: list[tuple[float, Array]] = []
        while not budget.spent:
            drawn = np.clip(mean + spread * rng.standard_normal((STARTS, *mean.shape)), -1.0, 1.0)
            actions = np.repeat(drawn, held, axis=1).transpose(1, 0, 2)
            distances = self._many.run(actions)
            budget.note(actions, distances)
            losses = (distances[-HOLD.steps :] ** 2).mean(axis=0)
            samples = sorted([*samples[:ELITES], *zip(losses.tolist(), drawn, strict=True)], key=lambda sample: sample[0])
            best = np.stack([knots for _, knots in samples[:ELITES]])
            mean, spread = best.mean(axis=0), 0.7 * best.std(axis=0) + 0.3 * spread
        return budget.plan

    def _loss(self, budget: _Budget) -> Callable[[Array], tuple[float, Array]]:
        """Mean squared distance over the last steps, and its derivatives, of flattened actions."""

        def loss(flat: Array) -> tuple[float, Array]:
            actions = flat.reshape(self._one.shape)
            distances = self._one.run(actions)
            budget.note(actions, distances)
            by = np.zeros_like(distances)
            by[-HOLD.steps :] = 2.0 * distances[-HOLD.steps :] / HOLD.steps
            return float((distances[-HOLD.steps :] ** 2).mean() * _SCALE), (_SCALE * self._one.pull_back(by)).ravel()

        return loss


_SCALE = 1e3
"""Unit of the loss: SciPy's first step has the length of the gradient."""


def _stop(budget: _Budget) -> Callable[[Any], None]:
    def callback(intermediate_result: Any) -> None:
        if budget.spent:
            raise StopIteration

    return callback


METHODS: dict[str, Callable[[Planner, int], Plan]] = {"gradient": Planner.by_gradient, "cross-entropy": Planner.by_cross_entropy}
