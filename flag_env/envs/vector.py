"""The native vector environments: many flags in one simulator, stepped in parallel threads.

`gymnasium.make_vec(id, num_envs=..., vectorization_mode="vector_entry_point")` gives one. Each flag goes through the same bits as
in the single environment, whatever their number and the number of threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from flag_env.control.base import CONTROL_STEP
from flag_env.envs.batch import EPISODE_STEPS, FlagBatch, Settings
from flag_env.envs.flag import RENDER_MODES, checked_render_mode, chosen_target
from flag_env.envs.picture import Picture
from flag_env.envs.views import FlatView, GoalView, goal_reward
from flag_env.physics import Scene, Simulator, validate
from flag_env.tasks.targets import Targets


class FlagVectorEnv(VectorEnv[Any, NDArray[np.float32], NDArray[Any]]):
    """Many `FlagEnv` in lock-step.

    Parameters
    ----------
    num_envs
        Number of flags.
    max_episode_steps
        Steps after which an episode is truncated.
    autoreset_mode
        "NextStep", "SameStep" or "Disabled", or Gymnasium's `AutoresetMode`.
    threads
        Threads of the simulator; None: as many as there are processors.
    control, level, split, scene, tolerance, reward, render_mode, width, height, accuracy
        See `FlagEnv`.
    """

    view: ClassVar[type[FlatView]] = FlatView

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = EPISODE_STEPS,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
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
        self.num_envs = validate.count("num_envs", num_envs)
        self.max_episode_steps = validate.count("max_episode_steps", max_episode_steps)
        modes = {mode.value: mode for mode in AutoresetMode}
        is_mode = isinstance(autoreset_mode, AutoresetMode)
        self.autoreset_mode = autoreset_mode if is_mode else modes[validate.choice("autoreset_mode", autoreset_mode, modes)]
        reward = self.view.rewards[0] if reward is None else validate.choice("reward", reward, self.view.rewards)
        self.render_mode = checked_render_mode(render_mode)
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": round(1 / CONTROL_STEP),
            "autoreset_mode": self.autoreset_mode,
        }
        self._batch = FlagBatch(Settings(control, level, split, scene, tolerance, accuracy), num_envs, threads)
        self._view = self.view(self._batch, reward)
        self._picture = Picture(width, height)
        self._rngs: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.ones(num_envs, bool)
        self.single_observation_space = self._view.space()
        self.single_action_space = spaces.Box(-1.0, 1.0, (self._batch.control.size,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    @property
    def simulator(self) -> Simulator:
        """The simulator of all flags."""
        return self._batch.simulator

    @property
    def library(self) -> Targets:
        """The targets of the split, with their witnesses."""
        return self._batch.library

    @property
    def target(self) -> NDArray[np.float64]:
        """Target positions [m], shape (num_envs, layers, rows, cols, 3)."""
        return np.array(self._batch.target)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes.

        Parameters
        ----------
        seed
            One number (copy i gets seed + i), one for each copy, or None.
        options
            {"reset_mask": bool array (num_envs,) of the copies to reset, "target": number of a target}, both optional.
        """
        options = dict(options or {})
        mask = self._mask(options.pop("reset_mask", None))
        target = chosen_target(options, len(self._batch.library))
        seeds = self._seeds(seed)
        which = np.flatnonzero(mask)
        for copy in which:
            if seeds[copy] is not None:
                self._rngs[copy] = seeding.np_random(seeds[copy])[0]
        self._start(which, target)
        return self._view.observe(), self._info(mask)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take one control step of every flag; actions of flags that are being reset are not read."""
        shape = (self.num_envs, self._batch.control.size)
        waiting = np.flatnonzero(self._ended)
        if len(waiting):
            if self.autoreset_mode is not AutoresetMode.NEXT_STEP or None in self._rngs:
                raise ValueError(f"reset() must be called for the copies {waiting.tolist()} before step()")
            actions = np.where(self._ended[:, None], 0.0, actions) if np.shape(actions) == shape else actions
        batch = self._batch
        batch.step(actions, shape)
        observation = self._view.observe()
        terms = self._view.terms(batch.before, batch.distance, observation)
        terminated, truncated = batch.diverged.copy(), batch.elapsed >= self.max_episode_steps
        stepped = ~self._ended
        if len(waiting):
            for result in (terminated, truncated, *terms.values()):
                result[waiting] = 0
            self._start(waiting, None)
            observation = self._view.observe()
        reward: Any = sum(terms.values())
        self._ended = terminated | truncated
        info = self._info(None, stepped, terms)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            observation, info = self._same_step_reset(observation, info)
        return observation, reward, terminated, truncated, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame of each flag with `render_mode="rgb_array"`, else None."""
        if self.render_mode is None:
            return None
        return tuple(self._picture.draw(self._batch, copy) for copy in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer."""
        del kwargs
        if hasattr(self, "_picture"):  # Gymnasium also closes what was never made, because its arguments were refused
            self._picture.close()

    def _start(self, which: NDArray[np.intp], target: int | None) -> None:
        for copy in which:
            if self._rngs[copy] is None:
                self._rngs[copy] = seeding.np_random()[0]
        count = len(self._batch.library)
        chosen = [int(self._rngs[copy].integers(count)) if target is None else target for copy in which]
        self._batch.reset(which.tolist(), chosen)
        self._ended[which] = False

    def _same_step_reset(self, observation: Any, info: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Reset what has ended; its last observation and info go into `final_obs` and `final_info`."""
        ended = self._ended.copy()
        final_obs = np.full(self.num_envs, None, dtype=object)
        for copy in np.flatnonzero(ended).tolist():
            final_obs[copy] = self._view.observation(copy)
        final_info = _masked(info, ended)
        self._start(np.flatnonzero(ended), None)
        fresh = self._info()
        live = {
            name: np.where(ended, fresh[name], value) if isinstance(value, np.ndarray) and name[0] != "_" else value
            for name, value in info.items()
        }
        live["reward_terms"] = _masked(info["reward_terms"], ~ended)
        live |= {"final_obs": final_obs, "_final_obs": ended, "final_info": final_info, "_final_info": ended}
        return self._view.observe(), live

    def _info(
        self,
        mask: NDArray[np.bool_] | None = None,
        stepped: NDArray[np.bool_] | None = None,
        terms: dict[str, NDArray[np.float64]] | None = None,
    ) -> dict[str, Any]:
        """Infos as arrays (num_envs,) of flags in `mask`, or of all, each with its mask; reward terms of those in `stepped`."""
        batch, there = self._batch, np.ones(self.num_envs, bool) if mask is None else mask.copy()
        result: dict[str, Any] = {}
        for name, value in (
            ("distance", batch.distance),
            ("is_success", batch.success),
            ("diverged", batch.diverged),
            ("target", batch.target_index),
        ):
            result[name] = value.copy() if mask is None else np.where(mask, value, np.zeros((), value.dtype))
            result[f"_{name}"] = there.copy()
        result["reward_terms"] = dict(terms or {})
        if stepped is not None:
            result["reward_terms"] |= {f"_{name}": stepped.copy() for name in result["reward_terms"]}
        result["_reward_terms"] = there
        return result

    def _mask(self, mask: Any) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num_envs, bool)
        if not isinstance(mask, np.ndarray) or mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(
                f"options['reset_mask'] must be a bool array of shape ({self.num_envs},) with at least one True, got {mask!r}"
            )
        return mask

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, (int, np.integer)):
            return [int(seed) + copy for copy in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed must be one number or {self.num_envs}, got {len(seed)}")
        return list(seed)


class FlagGoalVectorEnv(FlagVectorEnv):
    """Many `FlagGoalEnv` in lock-step."""

    view: ClassVar[type[GoalView]] = GoalView
    _view: GoalView

    def compute_reward(self, achieved_goal: NDArray[Any], desired_goal: NDArray[Any], info: Any) -> Any:
        """See `FlagGoalEnv`."""
        return goal_reward(self._view, achieved_goal, desired_goal)


def _masked(info: dict[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """The entries of an info dictionary where `mask` holds; zero elsewhere."""
    result: dict[str, Any] = {}
    for name, value in info.items():
        if isinstance(value, dict):
            result[name] = _masked(value, mask)
        elif name.startswith("_"):
            result[name] = value & mask
        else:
            result[name] = np.where(mask, value, np.zeros((), value.dtype))
    return result
