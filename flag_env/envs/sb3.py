"""The native vector environment as Stable-Baselines3 wants it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from flag_env.envs.batch import EPISODE_STEPS
from flag_env.envs.vector import FlagGoalVectorEnv, FlagVectorEnv
from flag_env.physics import Scene, validate

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
    control, level, split, scene, tolerance, render_mode, width, height, accuracy
        See `FlagEnv`.
    """

    def __init__(
        self,
        num_envs: int,
        env_id: str = "Flag-v0",
        max_episode_steps: int = EPISODE_STEPS,
        threads: int | None = None,
        control: str = "wind",
        level: str = "breeze",
        split: str = "train",
        scene: Scene | str = "flag",
        tolerance: float = 0.05,
        reward: str | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        accuracy: str | float | None = None,
    ) -> None:
        kind, own_reward = KINDS[validate.choice("env_id", env_id, KINDS)]
        self.env = kind(
            num_envs, max_episode_steps, AutoresetMode.SAME_STEP, threads, control, level, split, scene, tolerance,
            own_reward if reward is None else reward, render_mode, width, height, accuracy,
        )  # fmt: skip
        self._attributes: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._actions: NDArray[Any] = np.zeros(0)
        super().__init__(num_envs, self.env.single_observation_space, self.env.single_action_space)

    def reset(self) -> Any:
        """Start an episode of every flag, with the seeds and options that were set."""
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
        return value[copy] if name == "target" else value

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Give an attribute to these copies."""
        for copy in self._get_indices(indices):
            self._attributes[copy][attr_name] = value

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method for each of these copies; `compute_reward` serves hindsight replay."""
        count = len(list(self._get_indices(indices)))
        return [getattr(self.env, method_name)(*method_args, **method_kwargs) for _ in range(count)]

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
        entries = _singles(value, count) if isinstance(value, dict) else value.tolist()
        present = info[f"_{name}"].tolist()
        for single, entry, there in zip(result, entries, present, strict=True):
            if there:
                single[name] = entry
    return result
