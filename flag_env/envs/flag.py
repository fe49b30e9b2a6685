"""The single environment, `Flag-v0`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from flag_env.control import CONTROL_STEP, Control
from flag_env.envs import episode_state
from flag_env.envs.actions import check_action
from flag_env.envs.batch import FlagBatch
from flag_env.envs.config import EPISODE_STEPS, FlagConfig
from flag_env.envs.episode_state import EpisodeState
from flag_env.envs.picture import LivePage, Picture, snapshot
from flag_env.envs.time_limit import time_limit
from flag_env.envs.views import FlatView
from flag_env.physics import Scene, Simulator
from flag_env.render import Snapshot
from flag_env.tasks import Level, Targets

RENDER_MODES = ("human", "rgb_array")


class FlagEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """A flag is to take a target pose and hold it.

    ## Description

    A tapered mass-spring cloth of 1.5 m x 1.0 m hangs on a mast in a steady wind. In each episode the agent is shown a target
    pose and has 3 s (75 actions of 0.04 s) to bring every particle of the flag there and keep it there. Other levels ask to meet
    a pose at the last step, or to follow a motion. Every target is certified: a stored sequence of actions, its witness, is
    known to reach it.

    ## Action space

    `Box(-1, 1)`; values outside are clipped, NaN and infinity refused.

    `control="wind"`: 3 entries, set-points of the wind's amplitude along x, y, z. The amplitude follows with a lag of 0.2 s; at
    full action it accelerates the cloth by 6, 8, 5 m/s^2, times a slow cosine, on top of a steady 6 m/s^2 along x. Where the
    scene's wind is given by the velocity of the air, 1.5 m/s^2 stand for 1 m/s.

    `control="mast"`: 5 entries, set-points of the mast's velocity along x, y, z (at full action 1.5 m/s) and of its tilt rates
    about x and y (1 rad/s). They are followed with a lag of 0.1 s, within +-1 m and +-0.6 rad of the start.

    `control="both"`: the entries of "wind", then those of "mast". `control="wind+frequency"`: those of "wind", then set-points of
    its angular frequencies, from 0 to 6 rad/s. `control="mast+yaw"`: those of "mast", then the rate about its own axis (2 rad/s),
    for a flag that is pinned by a sleeve and targets of your own.

    ## Observation space

    `Box(-100, 100)`, float32. What it holds is the level's view; of "nodes", the nodes are 3 rows x 5 columns of particles:

    | entries | what | unit |
    |---|---|---|
    | 45 | positions of the nodes (x, y, z of each, row by row from below) | m |
    | 45 | their velocities | m/s |
    | 45 | target positions of the nodes | m |
    | 45 | target minus position | 0.1 flag diagonals; 0.5 under mast control |
    | 3 or 10 | actuators: wind amplitude; or mast pose and velocity | share of its range |
    | 1 | time left | share of the episode |

    View "mast" adds the pose of the target's mast and its difference to the mast's, before the time left. "sensors": positions,
    targets and differences of three markers, actuators, time left. "wave": positions and velocities of the nodes, where their
    targets will be in 1, 3, 6 and 12 steps minus where they are, in 0.1 diagonals, actuators, time left.

    ## Rewards

    With d = RMS distance of the particles to their targets / flag diagonal, "shaped" gives 0.1 for d < tolerance plus
    3 (d_before - 0.98 d), a potential-based term; "dense" gives -d; "sparse" gives -1 for d >= tolerance, else 0.
    "track" and "snap" are those of levels with motions, and with poses to be met in time; see `flag_env.tasks.reward`.

    ## Start and end

    The flag starts flat and at rest; the seed picks the target, and the turbulence of a scene that has any.
    `reset(options={"target": i})` picks target i of the split. An episode is truncated after 75 steps, or the
    `max_episode_steps` given to `gymnasium.make` (`TimeLimit`); it terminates only if the simulation diverges.

    `info` has the same keys after `reset` and `step`: `distance` d; `is_success`: whether d < tolerance held on each of the last
    10 steps, or the level's other goal is reached; `diverged`; `target`: number of the target in its split; and the terms of the
    reward, which sum to it: `reward_in_tolerance` and `reward_approach` of "shaped", `reward_distance` of "dense", `reward_miss`
    of "sparse".

    `env.unwrapped.get_state()` and `set_state(state)` take an episode out and put it back, to the bit.
    `env.unwrapped.witness()` gives actions (75, size) that reach the present target. In turbulence, which differs from episode
    to episode, targets are where witnesses lead under one draw of it, and no actions are sure to reach them.

    ## Arguments

    | name | default | meaning |
    |---|---|---|
    | `control` | "wind" | "wind", "mast", "both", "wind+frequency", "mast+yaw", or a `Control` class of your own |
    | `level` | "breeze" | "calm": the wind is known; "breeze": each target hides a wind; the other rungs; or a `Level` |
    | `split` | "train" | "train", "validation", "test", and "shift", with stronger hidden winds, of the levels that have it |
    | `scene` | None | "flag", "two_layer_flag" (10 x 16 particles) or a `Scene`, where witnesses lead; None: the level's |
    | `tolerance` | 0.05 | distance that counts as reached, in flag diagonals |
    | `reward` | None | "shaped", "dense", "sparse", "track" or "snap"; None: the level's |
    | `targets` | None | `Targets`, or the path of a library file, to have in place of the shipped ones |
    | `view` | None | "nodes", "mast", "sensors" or "wave"; None: the level's |
    | `render_mode` | None | "rgb_array", or "human": a page in the browser, which needs the extra "play" |
    | `width`, `height` | 480 | size of a frame in pixels |
    | `accuracy` | None | "fast", "balanced", "reference", or an error in metres; None: "balanced", but a `Scene` as it is |

    With another accuracy than the default one, actions and observations keep their meaning and shape, and targets are where the
    witnesses lead in that scene. "fast" halves the lattice of the flag (5 x 8 particles), "balanced" keeps the integration error
    below 1 mm over one second, "reference" below 1 micrometre; see `flag_env.physics.accuracy.tuning`.

    ## Versions

    * v0: first release.
    """

    view: ClassVar[type[FlatView]] = FlatView
    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": round(1 / CONTROL_STEP)}  # noqa: RUF012

    def __init__(
        self,
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
        config = FlagConfig(control, level, split, scene, tolerance, reward, render_mode, width, height, accuracy, targets, view)
        self.render_mode, rewarded = checked_render_mode(render_mode), self.view.reward_of(config)
        self._batch = FlagBatch(config)
        self._view = self.view(self._batch, rewarded)
        self._picture = Picture(width, height)
        self._page = LivePage(self.metadata["render_fps"]) if render_mode == "human" else None
        self._started = False
        self._target = 0
        self._action_shape = (self._batch.control.size,)
        self.action_space = spaces.Box(-1.0, 1.0, self._action_shape, np.float32)
        self.observation_space = self._view.space()

    @property
    def simulator(self) -> Simulator:
        """The flag's simulator."""
        return self._batch.simulator

    @property
    def library(self) -> Targets:
        """The targets of the split, with their witnesses."""
        return self._batch.library

    @property
    def target(self) -> NDArray[np.float64]:
        """Target positions [m], shape (layers, rows, cols, 3)."""
        return np.array(self._batch.target[0])

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        seed
            See Gymnasium.
        options
            {"target": number of a target of the split}, or None for a random one.
        """
        batch = self._batch
        target = chosen_target(options, len(batch.library))
        super().reset(seed=seed)
        batch.last(time_limit(self) or EPISODE_STEPS)
        batch.start([0], [self.np_random], target)
        self._target = int(batch.target_index[0])
        self._started = True
        if self._page is not None:
            self._page.show(batch, None)
        return self._view.observation(0), self._info(self._view.no_terms, batch.distance.item(), False, False)

    def step(self, action: NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take one control step of 0.04 s."""
        batch = self._batch
        if not self._started:
            check_action(action, self._action_shape)
            raise gymnasium.error.ResetNeeded("reset() must be called before step()")
        batch.step(action, self._action_shape)
        observation, distance, diverged = self._view.observation(0), batch.distance.item(), batch.diverged.item()
        last = batch.elapsed.item() == EPISODE_STEPS
        given = self._view.terms(batch.before.item(), distance, observation, last)
        terms = {name: float(value) for name, value in given.items()}
        info = self._info(terms, distance, batch.success.item(), diverged)
        if self._page is not None:
            self._page.show(batch, terms)
        return observation, sum(terms.values()), diverged, False, info

    def witness(self) -> NDArray[np.float32]:
        """Actions (75, size) that reach the present target from the start."""
        if not self._started:
            raise gymnasium.error.ResetNeeded("reset() must be called before witness()")
        return self._batch.witness(0)

    def get_state(self) -> EpisodeState:
        """Everything that this episode depends on, to the bit: simulator, actuators, target and counters."""
        if not self._started:
            raise gymnasium.error.ResetNeeded("reset() must be called before get_state()")
        return episode_state.get_state(self._batch, 0)

    def set_state(self, state: EpisodeState) -> None:
        """Go on from what `get_state` found here, in another environment of the same task, or in one flag of a vector of them.

        A time limit goes on counting the steps that were taken here.
        """
        episode_state.set_state(self._batch, [0], state)
        self._target, self._started = int(self._batch.target_index[0]), True

    def render(self) -> NDArray[np.uint8] | None:
        """A frame (height, width, 3) with `render_mode="rgb_array"`, else None; "human" shows every step by itself."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() draws nothing without render_mode="rgb_array" in gymnasium.make')
        if self.render_mode != "rgb_array":
            return None
        return self._picture.draw(self._batch)

    def snapshot(self) -> Snapshot:
        """What a picture of this moment shows: flag, target, wind and distance."""
        return snapshot(self._batch)

    def close(self) -> None:
        """Free the renderer, and close the page."""
        self._picture.close()
        if self._page is not None:
            self._page.close()

    def _info(self, terms: dict[str, float], distance: float, success: bool, diverged: bool) -> dict[str, Any]:
        return {
            "distance": distance,
            "is_success": success,
            "diverged": diverged,
            "target": self._target,
            **{f"reward_{name}": value for name, value in terms.items()},
        }


def checked_render_mode(render_mode: str | None, modes: tuple[str, ...] = RENDER_MODES) -> str | None:
    """The render mode; raise ValueError unless it is one of these."""
    if render_mode is not None and not (isinstance(render_mode, str) and render_mode in modes):
        raise ValueError(f"render_mode must be None or one of {modes}, got {render_mode!r}")
    return render_mode


def checked_options(options: Any) -> dict[str, Any]:
    """The options of a reset in a dictionary of their own; raise TypeError unless they are one, or None."""
    if options is not None and not isinstance(options, Mapping):
        raise TypeError(f"options must be None or a dictionary, got {options!r}")
    return dict(options or {})


def chosen_target(options: dict[str, Any] | None, count: int) -> int | None:
    """The target that reset options ask for, if any."""
    options = checked_options(options)
    unknown = set(options) - {"target"}
    if unknown:
        raise ValueError(f"options must hold no other key than 'target', got {sorted(map(repr, unknown))}")
    target = options.get("target")
    if target is None:
        return None
    if isinstance(target, bool) or not isinstance(target, (int, np.integer)) or not 0 <= target < count:
        raise ValueError(f"options['target'] must be a whole number from 0 to {count - 1}, got {target!r}")
    return int(target)
