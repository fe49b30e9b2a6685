"""Where every environment of training and evaluation is made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv
from stable_baselines3.common.vec_env import VecEnv

import flag_env  # noqa: F401  registers the ids
from flag_env.envs.sb3 import FlagSB3VecEnv


@dataclass(frozen=True)
class Task:
    """What is to be learnt: an environment id and the arguments that choose the problem."""

    env_id: str = "Flag-v0"
    control: str = "wind"
    level: str = "breeze"
    accuracy: str | float = "balanced"

    @property
    def name(self) -> str:
        """The id, with control and level, and with the accuracy, where they are not the default."""
        default = (self.control, self.level) == (Task.control, Task.level)
        name = self.env_id if default else f"{self.env_id}-{self.control}-{self.level}"
        return name if self.accuracy == Task.accuracy else f"{name}-{self.accuracy}"

    def make(self, split: str, **keywords: Any) -> gymnasium.Env:
        """One environment."""
        return gymnasium.make(self.env_id, split=split, **self.arguments, **keywords)

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the environment besides the split."""
        return {"control": self.control, "level": self.level, "accuracy": self.accuracy}


def learning_envs(task: Task, count: int, split: str) -> VecEnv:
    """Flags of a split, for stable-baselines3; they can be pickled in mid-episode, which checkpoints rely on."""
    return FlagSB3VecEnv(count, task.env_id, split=split, control=task.control, level=task.level, accuracy=task.accuracy)


def evaluation_envs(task: Task, count: int, split: str) -> VectorEnv:
    """Flags of a split, each of which can be reset to a target of its own."""
    return gymnasium.make_vec(
        task.env_id,
        num_envs=count,
        vectorization_mode="vector_entry_point",
        split=split,
        **task.arguments,
    )
