"""What happens between two rollouts: validation, then a checkpoint."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from gymnasium.vector import VectorEnv
from stable_baselines3.common.callbacks import BaseCallback

from training import checkpoint
from training.rollouts import Agent, rollout, summary


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


class Validation(BetweenRollouts):
    """Gathers the learning curve from episodes without exploration.

    Parameters
    ----------
    envs
        Environments of the validation split.
    targets
        Number of targets; the same ones every time.
    every
        Timesteps between two points of the curve.
    curve
        Points gathered so far.
    """

    def __init__(self, envs: VectorEnv, targets: int, every: int, curve: list[dict[str, Any]]) -> None:
        super().__init__()
        self._envs, self._targets, self._every = envs, targets, every
        self.curve = curve

    def act(self) -> None:
        """Add a point if one is due; the first and the last always are."""
        last = self.curve[-1]["timesteps"] if self.curve else -1
        due = last < 0 or self.finished or self.num_timesteps // self._every > last // self._every
        if last == self.num_timesteps or not due:
            return
        point = summary(rollout(Agent(self.model), self._envs, range(self._targets)))
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
