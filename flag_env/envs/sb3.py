"""The native vector environment as Stable-Baselines3 wants it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from flag_env import _validate
from flag_env.control import Control
from flag_env.envs.config import EPISODE_STEPS
from flag_env.envs.flag import chosen_target
from flag_env.envs.vector import FlagGoalVectorEnv, FlagVectorEnv
from flag_env.physics import Scene
from flag_env.tasks import Level, Targets

KINDS = {
    "Flag-v0": (FlagVectorEnv, None),
    "FlagGoal-v0": (FlagGoalVectorEnv, "sparse"),
    "FlagGoalDense-v0": (FlagGoalVectorEnv, "dense"),
}


class FlagSB3VecEnv(VecEnv):
    """Many flags as a Stable-Baselines3 `VecEnv`: terminal observations, truncation flags, reset infos.

    Parameters
    ----------
    num_envs
        Number of flags.
    env_id
        "Flag-v0", "FlagGoal-v0" or "FlagGoalDense-v0".
    reward
        None: the id's own.
    max_episode_steps, threads
        See `FlagVectorEnv`.
    control, level, split, scene, tolerance, render_mode, width, height, accuracy, targets, view
        See `FlagEnv`.
    """

    def __init__(
        self,
        num_envs: int,
        env_id: str = "Flag-v0",
        max_episode_steps: int = EPISODE_STEPS,
        threads: int | None = None,
        control: str | type[Control] = "wind",
        level: str | Level = "breeze",
        split: str = "train",
        scene: Scene | str | None = None,
        tolerance: float = 0.05,
        reward: str | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        accuracy: str | float | None = None,
        targets: Targets | str | Path | None = None,
        view: str | None = None,
    ) -> None:
        kind, own_reward = KINDS[_validate.choice("env_id", env_id, KINDS)]
        self.env = kind(
            num_envs, max_episode_steps, AutoresetMode.SAME_STEP, threads, control, level, split, scene, tolerance,
            own_reward if reward is None else reward, render_mode, width, height, accuracy, targets, view,
        )  # fmt: skip
        self._attributes: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._actions: NDArray[Any] = np.zeros(0)
        super().__init__(num_envs, self.env.single_observation_space, self.env.single_action_space)

    def reset(self) -> Any:
        """Start an episode of every flag, with the seeds and options that were set."""
        for option in self._options:  # all, before any flag is reset
            chosen_target(option, len(self.env.library))
        options = [dict(option or {}) for option in self._options]
        seeds = list(self._seeds)
        if all(option == options[0] for option in options):
            observation, info = self.env.reset(seed=seeds, options=options[0])
            self.reset_infos = _singles(info, self.num_envs)
        else:
            for copy, option in enumerate(options):
                mask = np.arange(self.num_envs) == copy
                observation, info = self.env.reset(seed=seeds, options={"reset_mask": mask, **option})
                self.reset_infos[copy] = _singles(info, self.num_envs)[copy]
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Take one control step of every flag."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        infos = _singles(info, self.num_envs)
        if done.any():
            last = _singles(info["final_info"], self.num_envs)
            for copy in np.flatnonzero(done).tolist():
                self.reset_infos[copy], infos[copy] = infos[copy], last[copy]
                infos[copy]["terminal_observation"] = info["final_obs"][copy]
        for single, cut in zip(infos, (truncated & ~terminated).tolist(), strict=True):
            single["TimeLimit.truncated"] = cut
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Free the renderer."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A frame of each flag."""
        return self.env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of each copy: what `set_attr` gave it, else as its single environment has it; all share a simulator."""
        own = ((copy, self._attributes[copy]) for copy in self._get_indices(indices))
        return [mine[attr_name] if attr_name in mine else self._attribute(attr_name, copy) for copy, mine in own]

    def _attribute(self, name: str, copy: int) -> Any:
        if name in ("observation_space", "action_space"):
            return getattr(self, name)
        value = getattr(self.env, name)
        return value[copy] if name in ("target", "np_random", "np_random_seed") else value

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Give an attribute to these copies."""
        for copy in self._get_indices(indices):
            self._attributes[copy][attr_name] = value

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of each of these copies alone, as its single environment has it.

        There are "reset", "render", "witness" and, for hindsight replay, "compute_reward"; others raise AttributeError: flags in
        lock-step cannot take them one by one.
        """
        return [self._method(method_name, copy)(*method_args, **method_kwargs) for copy in self._get_indices(indices)]

    def _method(self, name: str, copy: int) -> Callable[..., Any]:
        """A method of one flag alone."""
        if name == "compute_reward" and isinstance(self.env, FlagGoalVectorEnv):
            return self.env.compute_reward
        methods = {"reset": self._reset_one, "render": self._render_one, "witness": self._witness_of}
        if name not in methods:
            raise AttributeError(f"method_name must be one of {', '.join(methods)}, or compute_reward of goals, got {name!r}")
        return partial(methods[name], copy)

    def _reset_one(self, copy: int, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        seeds: list[int | None] = [None] * self.num_envs
        seeds[copy] = seed
        chosen_target(options, len(self.env.library))
        mask = np.arange(self.num_envs) == copy
        observation, info = self.env.reset(seed=seeds, options={"reset_mask": mask, **(options or {})})
        if isinstance(observation, dict):
            return {key: part[copy] for key, part in observation.items()}, _singles(info, self.num_envs)[copy]
        return observation[copy], _singles(info, self.num_envs)[copy]

    def _render_one(self, copy: int) -> NDArray[np.uint8] | None:
        return None if self.env.render_mode is None else self.env.frame(copy)

    def _witness_of(self, copy: int) -> NDArray[np.float32]:
        return self.env.witness(copy)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No copy is wrapped."""
        del wrapper_class
        return [False for _ in self._get_indices(indices)]


def _singles(info: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Each copy's info, as the single environment gives it."""
    result: list[dict[str, Any]] = [{} for _ in range(count)]
    for name, value in info.items():
        if name.startswith(("_", "final_")):
            continue
        for single, entry, there in zip(result, value.tolist(), info[f"_{name}"].tolist(), strict=True):
            if there:
                single[name] = entry
    return result
