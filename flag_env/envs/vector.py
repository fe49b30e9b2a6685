"""The native vector environments: many flags in one simulator, stepped in parallel threads.

`gymnasium.make_vec(id, num_envs=..., vectorization_mode="vector_entry_point")` gives one. Each flag goes through the same bits as
in the single environment, whatever their number and the number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.control import CONTROL_STEP, Control
from flag_env.envs import episode_state
from flag_env.envs.batch import FlagBatch
from flag_env.envs.config import EPISODE_STEPS, FlagConfig
from flag_env.envs.episode_state import EpisodeState
from flag_env.envs.flag import checked_options, checked_render_mode, chosen_target
from flag_env.envs.picture import Picture
from flag_env.envs.views import FlatView, GoalView, goal_reward
from flag_env.physics import Scene, Simulator
from flag_env.tasks import Level, Targets

RENDER_MODES = ("rgb_array",)


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
    control, level, split, scene, tolerance, reward, render_mode, width, height, accuracy, targets, view
        See `FlagEnv`.
    """

    view: ClassVar[type[FlatView]] = FlatView

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = EPISODE_STEPS,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
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
        self.num_envs = _validate.count("num_envs", num_envs)
        self.max_episode_steps = _validate.count("max_episode_steps", max_episode_steps)
        modes = {mode.value: mode for mode in AutoresetMode}
        is_mode = isinstance(autoreset_mode, AutoresetMode)
        self.autoreset_mode = autoreset_mode if is_mode else modes[_validate.choice("autoreset_mode", autoreset_mode, modes)]
        config = FlagConfig(control, level, split, scene, tolerance, reward, render_mode, width, height, accuracy, targets, view)
        self.render_mode, rewarded = checked_render_mode(render_mode, RENDER_MODES), self.view.reward_of(config)
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": round(1 / CONTROL_STEP),
            "autoreset_mode": self.autoreset_mode,
        }
        self._batch = FlagBatch(config, num_envs, threads, episode_steps=self.max_episode_steps)
        self._view = self.view(self._batch, rewarded)
        self._picture = Picture(width, height)
        self._rngs: list[tuple[np.random.Generator, int] | None] = [None] * num_envs
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

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]  # one a flag, as SyncVectorEnv has
        """Each flag's generator."""
        return tuple(self._rng(copy)[0] for copy in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """What each flag's generator was seeded with."""
        return tuple(self._rng(copy)[1] for copy in range(self.num_envs))

    def witness(self, copy: int) -> NDArray[np.float32]:
        """Actions (75, size) that reach the present target of one flag from the start."""
        return self._batch.witness(copy)

    def get_state(self, copy: int) -> EpisodeState:
        """Everything that one flag's episode depends on, to the bit: simulator, actuators, target and counters."""
        return episode_state.get_state(self._batch, copy)

    def set_state(self, state: EpisodeState, copies: Sequence[int] | None = None) -> None:
        """Let these flags, or all, go on from what `get_state` of a vector or a single environment of the same task found."""
        chosen = list(range(self.num_envs)) if copies is None else _validate.counts("copies", copies, 0, self.num_envs - 1)
        episode_state.set_state(self._batch, chosen, state)
        self._ended[chosen] = False

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

        Raises
        ------
        TypeError, ValueError
            If one of them is not as told; nothing has changed then.
        """
        options = checked_options(options)
        mask = self._mask(options.pop("reset_mask", None))
        target = chosen_target(options, len(self._batch.library))
        seeds = self._seeds(seed)
        self._start(np.flatnonzero(mask), target, seeds)
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
        terms = self._view.terms(batch.before, batch.distance, observation, batch.elapsed == EPISODE_STEPS)
        terminated, truncated = batch.diverged.copy(), batch.elapsed >= self.max_episode_steps
        if len(waiting):
            for result in (terminated, truncated, *terms.values()):
                result[waiting] = 0
            self._start(waiting)
            observation = self._view.observe()
        reward: Any = sum(terms.values())
        self._ended = terminated | truncated
        info = self._info(terms=terms)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            observation, info = self._same_step_reset(observation, info)
        return observation, reward, terminated, truncated, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame of each flag with `render_mode="rgb_array"`, else None."""
        if self.render_mode is None:
            return None
        return tuple(self.frame(copy) for copy in range(self.num_envs))

    def frame(self, copy: int) -> NDArray[np.uint8]:
        """A frame of one flag, shape (height, width, 3)."""
        return self._picture.draw(self._batch, copy)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer."""
        del kwargs
        if hasattr(self, "_picture"):  # Gymnasium also closes what was never made, because its arguments were refused
            self._picture.close()

    def _start(self, which: NDArray[np.intp], target: int | None = None, seeds: Sequence[int | None] = ()) -> None:
        """Start episodes of these flags, with new generators for those that have seeds."""
        copies = which.tolist()
        fresh = {copy: seeding.np_random(seeds[copy]) for copy in copies if seeds and seeds[copy] is not None}
        rngs = {copy: fresh.get(copy) or self._rng(copy) for copy in copies}
        self._batch.start(copies, [rngs[copy][0] for copy in copies], target)
        for copy, rng in fresh.items():
            self._rngs[copy] = rng
        self._ended[which] = False

    def _rng(self, copy: int) -> tuple[np.random.Generator, int]:
        """A flag's generator and what it was seeded with."""
        if (rng := self._rngs[copy]) is None:
            rng = self._rngs[copy] = seeding.np_random()
        return rng

    def _same_step_reset(self, observation: Any, info: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Reset what has ended; its last observation and info go into `final_obs` and `final_info`."""
        ended = self._ended.copy()
        final_obs = np.full(self.num_envs, None, dtype=object)
        for copy in np.flatnonzero(ended).tolist():
            final_obs[copy] = self._view.observation(copy)
        final_info = _masked(info, ended)
        self._start(np.flatnonzero(ended))
        fresh = self._info()
        live = {
            name: np.where(ended, fresh[name], value) if isinstance(value, np.ndarray) and name[0] != "_" else value
            for name, value in info.items()
        }
        live |= {"final_obs": final_obs, "_final_obs": ended, "final_info": final_info, "_final_info": ended}
        return self._view.observe(), live

    def _info(self, mask: NDArray[np.bool_] | None = None, terms: dict[str, NDArray[np.float64]] | None = None) -> dict[str, Any]:
        """Infos as arrays (num_envs,) of flags in `mask`, or of all, each with its mask; no reward without `terms`."""
        batch, there = self._batch, np.ones(self.num_envs, bool) if mask is None else mask
        values: dict[str, NDArray[Any]] = {
            "distance": batch.distance,
            "is_success": batch.success,
            "diverged": batch.diverged,
            "target": batch.target_index,
        }
        for name in self._view.no_terms:
            values[f"reward_{name}"] = np.zeros(self.num_envs) if terms is None else terms[name]
        result: dict[str, Any] = {}
        for name, value in values.items():
            result[name] = value.copy() if mask is None else np.where(mask, value, np.zeros((), value.dtype))
            result[f"_{name}"] = there.copy()
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
        if isinstance(seed, np.ndarray):
            seed = seed.tolist()
        if not isinstance(seed, Sequence) or isinstance(seed, str):
            first = _validate.count("seed", seed, minimum=0, maximum=math.inf)
            return [first + copy for copy in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed must be one number or {self.num_envs}, got {len(seed)}")
        return [None if one is None else _validate.count("seed", one, minimum=0, maximum=math.inf) for one in seed]


class FlagGoalVectorEnv(FlagVectorEnv):
    """Many `FlagGoalEnv` in lock-step."""

    view: ClassVar[type[GoalView]] = GoalView
    _view: GoalView

    def compute_reward(self, achieved_goal: NDArray[Any], desired_goal: NDArray[Any], info: Any) -> Any:
        """See `FlagGoalEnv`."""
        return goal_reward(self._view, achieved_goal, desired_goal)


def _masked(info: dict[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """The entries of an info dictionary where `mask` holds; zero elsewhere."""
    return {
        name: value & mask if name.startswith("_") else np.where(mask, value, np.zeros((), value.dtype))
        for name, value in info.items()
    }
