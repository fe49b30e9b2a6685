"""An episode of the environment for the page: an agent, a witness or a hand acts, and the scores are kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.control import CONTROL_STEP, CONTROLS
from flag_env.envs.config import EPISODE_STEPS
from flag_env.envs.flag import FlagEnv
from flag_env.render import Snapshot
from flag_env.tasks import checked_level

Act = Callable[[Any], NDArray[np.float32]]
"""A policy: from an observation to an action."""

DRIVERS = ("witness", "agent", "hand")

REST = 1.2
"""Time for which the end of an episode stands [s]."""


@dataclass(frozen=True)
class Task:
    """Which environment, and where its targets are from."""

    control: str = "wind"
    level: str = "breeze"
    env_id: str = "Flag-v0"
    split: str = "test"
    accuracy: str | float | None = None

    def __post_init__(self) -> None:
        _validate.choice("control", self.control, CONTROLS)
        checked_level(self.control, self.level)

    def make(self) -> gymnasium.Env[Any, Any]:
        """One environment."""
        return gymnasium.make(
            self.env_id,
            control=self.control,
            level=self.level,
            split=self.split,
            accuracy=self.accuracy,
            disable_env_checker=True,
        )


@dataclass
class Score:
    """One run at a target: distance and rewards step by step."""

    distance: list[float] = field(default_factory=list)
    terms: dict[str, list[float]] = field(default_factory=dict)
    success: bool = False

    def add(self, info: dict[str, Any]) -> None:
        """One step more."""
        self.distance.append(round(float(info["distance"]), 5))
        for key, value in info.items():
            if key.startswith("reward_"):
                self.terms.setdefault(key.removeprefix("reward_"), []).append(round(float(value), 5))
        self.success = bool(info["is_success"])

    @property
    def total(self) -> float:
        """Sum of the rewards."""
        return sum(sum(values) for values in self.terms.values())


class Episode:
    """Episodes one after another.

    Parameters
    ----------
    task
        The environment.
    driver
        Who acts: "witness", "agent" or "hand".
    target
        Number of the target in its split.
    agent
        The policy, if there is one; it must have been trained for the task.

    Attributes
    ----------
    version
        Grows with every target.
    score, reference
        The driver's run so far; the whole run of the agent, or without one of the witness, at the same target.
    """

    def __init__(self, task: Task, driver: str, target: int = 0, agent: Act | None = None) -> None:
        self.task, self._agent = task, agent
        self.driver = self._checked(driver)
        self._env, self._shadow = task.make(), task.make()
        self.count = len(self.env.library)
        self._size = self._env.action_space.shape[0]  # type: ignore[index]
        self.hand = np.zeros(self._size, np.float32)
        self.paused, self.version, self.message = False, 0, ""
        self.begin(target)

    def _checked(self, driver: str) -> str:
        if _validate.choice("driver", driver, DRIVERS) == "agent" and self._agent is None:
            raise ValueError("driver must be 'witness' or 'hand' without an agent; give one: flag-env play --agent RUN")
        return driver

    def drive(self, driver: str, target: int) -> None:
        """Start an episode with another driver or target."""
        driver = self._checked(driver)
        self.begin(target)
        self.driver = driver

    def begin(self, target: int) -> None:
        """Start an episode with this target."""
        number = _validate.count("target", target, minimum=0)
        if number >= self.count:
            raise ValueError(f"target must be at most {self.count - 1}, got {number}")
        self.target = number
        self._observation, info = self._env.reset(options={"target": number})
        self.score, self.steps, self._owed = Score(), 0, 0.0
        self.distance = float(info["distance"])
        self.reference = self._whole_run(self._shadow, "agent" if self._agent else "witness")
        self.version += 1

    def act(self, values: Any) -> None:
        """Set the action of the hand, entries in [-1, 1]."""
        self.hand = np.clip(_validate.array("values", values, (self._size,)), -1.0, 1.0).astype(np.float32)

    def advance(self, seconds: float) -> None:
        """Take the control steps that are due; after the end, wait, then go on with the next target."""
        if self.paused:
            return
        self._owed += seconds
        while self._owed >= CONTROL_STEP:
            self._owed -= CONTROL_STEP
            if not self.done:
                self.step()
            elif self._owed > REST:
                self.begin((self.target + 1) % self.count)
            else:
                self._owed += CONTROL_STEP
                return

    @property
    def done(self) -> bool:
        """Whether the episode is over."""
        return self.steps >= EPISODE_STEPS

    def step(self) -> None:
        """One control step."""
        if self.done:
            return
        action = self._action(self.driver, self._observation, self.steps)
        self._observation, _, terminated, _, info = self._env.step(action)
        self.score.add(info)
        self.distance = float(info["distance"])
        self.steps = EPISODE_STEPS if terminated else self.steps + 1
        self.message = "the simulation diverged" if info["diverged"] else ""

    @property
    def env(self) -> FlagEnv:
        """The environment itself, without wrappers."""
        return self._env.unwrapped  # type: ignore[return-value]

    def snapshot(self) -> Snapshot:
        """The flag, its target and the wind now."""
        return self.env.snapshot()

    def status(self) -> dict[str, Any]:
        """Scores for the page."""
        return {
            "driver": self.driver,
            "target": self.target,
            "targets": self.count,
            "steps": self.steps,
            "length": EPISODE_STEPS,
            "tolerance": self.snapshot().tolerance,
            "action": [round(float(entry), 3) for entry in self._shown],
            "distance": self.score.distance,
            "terms": self.score.terms,
            "total": round(self.score.total, 3),
            "success": self.score.success,
            "reference": {
                "who": "agent" if self._agent else "witness",
                "distance": self.reference.distance,
                "total": round(self.reference.total, 3),
                "success": self.reference.success,
            },
        }

    def close(self) -> None:
        """Free the environments."""
        self._env.close()
        self._shadow.close()

    def _action(self, driver: str, observation: Any, step: int) -> NDArray[np.float32]:
        if driver == "hand":
            action = self.hand
        elif driver == "agent":
            assert self._agent is not None
            action = self._agent(observation)
        else:
            action = self.env.witness()[step]
        self._shown = action
        return action

    def _whole_run(self, env: gymnasium.Env[Any, Any], driver: str) -> Score:
        """A whole episode at once."""
        score = Score()
        observation, _ = env.reset(options={"target": self.target})
        for step in range(EPISODE_STEPS):
            observation, _, terminated, _, info = env.step(self._action(driver, observation, step))
            score.add(info)
            if terminated:
                break
        self._shown = np.zeros(self._size, np.float32)
        return score
