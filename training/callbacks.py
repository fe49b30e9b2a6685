"""What happens between two rollouts: validation, then a checkpoint."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.vec_env import VecEnv

from flag_env.envs.config import EPISODE_STEPS
from flag_env.tasks import HOLD, Goal
from training import checkpoint
from training.rollouts import summary


class BetweenRollouts(BaseCallback):
    """Acts when the model is at rest: before the first rollout, between rollouts, and after the last update."""

    def act(self) -> None:
        """Do what is due."""
        raise NotImplementedError

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self.act()

    def _on_training_end(self) -> None:
        if self.finished:  # else another callback stopped it in the middle of a rollout
            self.act()

    @property
    def finished(self) -> bool:
        """Whether all timesteps are done."""
        return self.model.num_timesteps >= self.model._total_timesteps


class Evaluation(EvalCallback):
    """SB3's evaluation without exploration, one episode an environment; keeps the distances of every step.

    Parameters
    ----------
    envs
        Environments to evaluate in.
    """

    def __init__(self, envs: VecEnv) -> None:
        super().__init__(envs, n_eval_episodes=envs.num_envs, eval_freq=1, verbose=0, warn=False)
        self.distances: NDArray[np.float64] = np.zeros((0, EPISODE_STEPS))

    def begin(self) -> None:
        """Ask for the same targets as every time, a target an environment."""
        self.eval_env.set_options([{"target": target} for target in range(self.n_eval_episodes)])
        self.distances = np.full((self.n_eval_episodes, EPISODE_STEPS), np.inf)  # infinite after a divergence
        self._steps = np.zeros(self.n_eval_episodes, int)

    def _log_success_callback(self, locals_: dict[str, Any], globals_: dict[str, Any]) -> None:
        super()._log_success_callback(locals_, globals_)
        copy, info = locals_["i"], locals_["info"]
        if not info["diverged"]:
            self.distances[copy, self._steps[copy]] = info["distance"]
        self._steps[copy] += 1


class Validation(BetweenRollouts):
    """Gathers the learning curve from episodes without exploration.

    Parameters
    ----------
    envs
        Environments of the validation split, each for one of its first targets.
    every
        Timesteps between two points of the curve.
    curve
        Points gathered so far.
    goal
        What counts as success.
    """

    def __init__(self, envs: VecEnv, every: int, curve: list[dict[str, Any]], goal: Goal = HOLD) -> None:
        super().__init__()
        self._goal = goal
        self._evaluation, self._every = Evaluation(envs), every
        self.curve = curve

    def _init_callback(self) -> None:
        self._evaluation.init_callback(self.model)

    def act(self) -> None:
        """Add a point if one is due; the first and the last always are."""
        last = self.curve[-1]["timesteps"] if self.curve else -1
        due = last < 0 or self.finished or self.num_timesteps // self._every > last // self._every
        if last == self.num_timesteps or not due:
            return
        self._evaluation.begin()
        self._evaluation.on_step()
        point = summary(self._evaluation.distances, self._goal)
        self.curve.append({"timesteps": self.num_timesteps, **point})
        for name, value in point.items():
            if value is not None:
                self.logger.record(f"validation/{name}", value)


class Checkpoints(BetweenRollouts):
    """Writes a checkpoint between rollouts.

    Parameters
    ----------
    folder
        Where to write.
    every
        Least number of timesteps between two checkpoints; at 0 no more than one rollout is ever lost.
    curve
        The learning curve, which `Validation` extends.
    seconds
        Training time of the sessions before this one [s].
    """

    def __init__(self, folder: Path, every: int, curve: list[dict[str, Any]], seconds: float) -> None:
        super().__init__()
        self._folder, self._every, self._curve = folder, every, curve
        self._began = time.perf_counter() - seconds
        self._last = -1

    @property
    def seconds(self) -> float:
        """Training time so far [s]."""
        return time.perf_counter() - self._began

    def _on_training_start(self) -> None:
        self._last = self.num_timesteps

    def act(self) -> None:
        """Write a checkpoint if one is due; the last one always is."""
        if self.num_timesteps > self._last and (self.finished or self.num_timesteps - self._last >= self._every):
            checkpoint.save(self._folder, self.model, {"curve": self._curve, "seconds": self.seconds})
            self._last = self.num_timesteps
