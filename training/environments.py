"""Where every environment of training and evaluation is made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

import flag_env  # noqa: F401  registers the ids
from flag_env import _validate
from flag_env.control import CONTROLS, Control
from flag_env.envs.batch import replay
from flag_env.envs.config import FlagConfig
from flag_env.envs.frames import Frames
from flag_env.envs.observation import ObservationLayout, observed_nodes
from flag_env.envs.sb3 import FlagSB3VecEnv
from flag_env.tasks import Goal, Targets, checked_level, load_targets


@dataclass(frozen=True)
class Task:
    """What is to be learnt: an environment id and the arguments that choose the problem."""

    env_id: str = "Flag-v0"
    control: str = "wind"
    level: str = "breeze"
    accuracy: str | float = "balanced"

    def __post_init__(self) -> None:
        _validate.choice("control", self.control, CONTROLS)
        checked_level(self.control, self.level)

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
    def goal(self) -> Goal:
        """What counts as success."""
        return checked_level(self.control, self.level).goal

    @property
    def sizes(self) -> dict[str, int]:
        """Number of targets of each split."""
        return checked_level(self.control, self.level).sizes

    def targets(self, split: str) -> Targets:
        """Witnesses and hidden winds of a split, and poses where they are shipped."""
        return load_targets(self.control, checked_level(self.control, self.level).library or self.level, split)

    @property
    def config(self) -> FlagConfig:
        """The same for what is below the environments."""
        return FlagConfig(self.control, self.level, accuracy=self.accuracy)

    @property
    def control_type(self) -> type[Control]:
        """What acts."""
        return self.config.control_type

    @property
    def layout(self) -> ObservationLayout:
        """What stands where in an observation."""
        config = self.config
        return ObservationLayout.of(len(observed_nodes(config.resolved_scene(), config.seen)), config.control_type, config.seen)

    @property
    def diagonal(self) -> float:
        """Diagonal of the flag [m]."""
        return self.config.resolved_scene().lattice.diagonal

    @property
    def shape(self) -> tuple[int, ...]:
        """Layers, rows and columns of the flag."""
        return self.config.resolved_scene().lattice.shape

    def frames(self, split: str) -> NDArray[np.float64]:
        """Flat positions of a split's targets, (targets, frames, 3 particles) [m]."""
        return Frames(replace(self.config, split=split), replay).all()

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
