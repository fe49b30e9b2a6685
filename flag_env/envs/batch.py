"""Episodes of many flags in lock-step: what the single and the vector environments share, so that they agree bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.control import CONTROL_STEP, Control, mast_pose, wind_of
from flag_env.envs import evaluate
from flag_env.envs.actions import not_finite, shaped
from flag_env.envs.config import EPISODE_STEPS, LARGEST_COORDINATE, WIND, FlagConfig
from flag_env.envs.frames import Frames
from flag_env.envs.observation import BOUND, LOOKAHEAD, ObservationLayout, observed_nodes
from flag_env.physics import Frame, Simulator
from flag_env.tasks import Targets

Array = NDArray[np.float64]
Evaluation = Callable[[int, int], None]

LARGEST_SPEED = float(np.finfo(np.float64).max)
"""Largest component of a velocity that still counts as simulated [m/s]."""


class FlagBatch:
    """Many flags, each in an episode of its own.

    What a step leads to stands in the attributes until the next step or reset, which write over it.

    Parameters
    ----------
    config
        The task.
    copies
        Number of flags.
    threads
        See `Simulator`.
    episode_steps
        Length of an episode, of which an agent sees the share that is left.

    Attributes
    ----------
    now : Frame
        Positions and velocities.
    before, distance : (copies,)
        RMS distance to the target / flag diagonal, before and after the step.
    success : (copies,)
        Whether the flag has done what the level's goal asks for.
    diverged : (copies,)
        Whether the simulation left the finite numbers, or the room; the flag then shows its last state that had not.
    follows : bool
        Whether targets move, or are seen in advance.
    layout
        What stands where in an observation.
    observed : (copies, entries) float32
        What an agent sees.
    rows : list of (entries,) float32
        The same, and the same memory, of each flag.
    """

    _evaluate_now: Evaluation
    _evaluate_last: Evaluation

    def __init__(
        self,
        config: FlagConfig,
        copies: int = 1,
        threads: int | None = None,
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        self.config, self.episode_steps = config, episode_steps
        scene = config.resolved_scene()
        self.scene = scene
        self.simulator = Simulator(scene, copies, threads=threads)
        self.steps_per_action = round(CONTROL_STEP / self.simulator.timestep)
        self.control: Control = config.control_type(scene, copies)
        self.library = config.library
        self._targets = np.zeros((copies, 3 * scene.lattice.size))
        self.target_index = np.zeros(copies, np.int64)
        self.hidden_wind = np.zeros((copies, 3))
        self.now, self._last = self.simulator.frame(), self.simulator.frame()
        self.before, self.distance = np.zeros(copies), np.zeros(copies)
        self.success, self.diverged = np.zeros(copies, bool), np.zeros(copies, bool)
        self.elapsed, self.held = np.zeros(copies, np.int64), np.zeros(copies, np.int64)
        self._start = Simulator(scene).get_state()
        self._start_positions = Simulator(scene).positions.reshape(-1)
        self.goal = config.task.goal
        self.nodes = observed_nodes(scene, config.seen)
        self.layout = ObservationLayout.of(len(self.nodes), config.control_type, config.seen)
        looks = len(LOOKAHEAD) * (self.layout.ahead.stop > self.layout.ahead.start)
        self._ahead = np.zeros((copies, looks, 3 * len(self.nodes)))
        self._coordinates = (3 * self.nodes[:, None] + np.arange(3)).ravel()
        self._mast_target = np.zeros((copies, self.layout.mast_target.stop - self.layout.mast_target.start))
        self.diagonal = scene.lattice.diagonal
        self.observed = np.zeros((copies, self.layout.size), np.float32)
        self._frames, self.follows = Frames(config, replay), False
        self._windy = any(effect.wind_unit for effect in scene.effects)
        self._bind()

    @property
    def copies(self) -> int:
        """Number of flags."""
        return self.simulator.copies

    @property
    def target(self) -> Array:
        """Target positions [m], shape (copies, layers, rows, cols, 3)."""
        return self._targets.reshape(self.now.shape)

    def witness(self, copy: int) -> NDArray[np.float32]:
        """Actions (steps, size) that reach a flag's present target from the start."""
        return self.library.actions(int(self.target_index[copy]))

    def frames_of(self, chosen: Sequence[int]) -> Array:
        """Target positions after each step [m], (steps, targets, layers, rows, cols, 3); of targets at rest, of one step."""
        steps = np.tile(np.arange(self._frames.count)[:, None], (len(chosen), 1, 1))
        found = self._frames.at(chosen, steps).reshape(len(chosen), self._frames.count, *self.now.shape[1:])
        return found.swapaxes(0, 1)

    def last(self, episode_steps: int) -> None:
        """Let episodes take this many steps from the next reset on."""
        if episode_steps != self.episode_steps:
            self.episode_steps = episode_steps
            self._bind()

    def start(self, copies: Sequence[int], generators: Sequence[np.random.Generator], target: int | None = None) -> None:
        """Start an episode of each of `copies`, with a random target or that of a number, and with turbulence of its own.

        What is random is drawn from each copy's own generator: the target first, then the turbulence, if the scene has any.
        """
        count = len(self.library)
        chosen = [int(generator.integers(count)) if target is None else target for generator in generators]
        drawn = self.simulator.turbulent and not self.library.own_turbulence
        seeds = [int(generator.integers(2**63)) for generator in generators] if drawn else None
        self.reset(copies, chosen, seeds=seeds)

    def reset(
        self, copies: Sequence[int], chosen: Sequence[int], poses: Array | None = None, seeds: Sequence[int] | None = None
    ) -> None:
        """Start an episode of each of `copies` with the target of the number in `chosen`, or the given target poses.

        Turbulence starts from `seeds`; None: from those of the targets, or, where they have none, the same for all.
        """
        which = np.asarray(copies, np.intp)
        if seeds is None and self.simulator.turbulent and self.library.own_turbulence:
            seeds = [self.library.turbulence_seed(index) for index in chosen]
        self.follows = poses is None and (self.goal.moving or self._ahead.size > 0)
        shown = poses is None
        if poses is None:
            poses = self._frames.at(chosen, np.zeros(len(which), np.int64))
        if len(which) == self.copies:
            self.simulator.set_state(self._start)
        else:  # factors of set_parameters are those of all flags, and stay
            self.simulator.set_state(replace(self._start, scales=self.simulator.scales), copies=which.tolist())
        if seeds is not None:
            self.simulator.reseed(which.tolist(), seeds)
        self.control.reset(self.simulator, which)
        self.target_index[which] = chosen
        self._targets[which] = poses.reshape(len(which), -1)
        if shown and self._mast_target.size:
            self._mast_target[which] = self.control.mast_share(mast_pose(self.target[which][:, 0, :, 0]))
        self.hidden_wind[which] = self.library.wind[chosen]
        self._set_ambient_wind()
        self.elapsed[which] = 0
        self.held[which] = 0
        self.success[which] = self.diverged[which] = False
        self.now.x[which], self.now.v[which] = self._start_positions, 0.0
        if self.follows:
            self._look_ahead(self.elapsed)
        self._evaluation(self.now, self._last, stepped=False)(0, self.copies)

    def step(self, action: Any, shape: tuple[int, ...]) -> None:
        """Take one control step under an action of `shape`, copies x size entries, clipped to [-1, 1].

        Raises
        ------
        ValueError
            If the action is of another shape or not finite; nothing has changed then.
        """
        if not self.control.apply(self.simulator, shaped(action, shape)):
            raise not_finite(action)
        self.now, self._last = self._last, self.now
        self._evaluate_now, self._evaluate_last = self._evaluate_last, self._evaluate_now
        if self.follows:
            self._targets[:] = self._frames.at(self.target_index, self.elapsed)
            self._look_ahead(self.elapsed + 1)
        self.simulator.step_into(self.steps_per_action, self.now, self._evaluate_now)

    def wind(self, copy: int = 0) -> Array | None:
        """Wind acceleration on the flag now (x, y, z) [m/s^2]; None in a scene without wind."""
        wind = self.simulator.wind()
        return None if wind is None else wind[copy] / wind_of(self.scene, np.ones(3))

    def _look_ahead(self, elapsed: NDArray[np.int64]) -> None:
        """Note where the targets' nodes will be, seen from these steps of the episodes."""
        if self._ahead.size:
            steps = elapsed[:, None, None] + np.array(LOOKAHEAD)[:, None] - 1
            self._ahead[:] = self._frames.at(self.target_index, steps, self._coordinates)

    def _bind(self) -> None:
        """Tie machine code to the batch's arrays, and rows to `observed`."""
        self._evaluate_now = self._evaluation(self.now, self._last, stepped=True)
        self._evaluate_last = self._evaluation(self._last, self.now, stepped=True)
        self.rows = list(self.observed)

    def _evaluation(self, now: Frame, last: Frame, stepped: bool) -> Evaluation:
        """Function that looks at the flags from a first to before a last, which have taken a step or not."""
        return partial(
            evaluate.evaluate_step(), now.x, now.v, last.x, last.v, self._targets, self._ahead, self.nodes, self.control.state,
            self._mast_target, (self.control.mast_pose or slice(0, 0)).start, LARGEST_COORDINATE, LARGEST_SPEED, self.diagonal,
            self.control.error_scale * self.diagonal, 0.1 * self.diagonal, self.config.tolerance, self.goal.steps,
            self.goal.earliest, self.episode_steps, BOUND, self.layout.starts, self.elapsed, self.held, self.before,
            self.distance, self.success, self.diverged, self.observed, stepped,
        )  # fmt: skip

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_evaluate_now": None, "_evaluate_last": None, "rows": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bind()

    def _set_ambient_wind(self) -> None:
        if self._windy:
            self.simulator.set_wind(mean=wind_of(self.scene, WIND + self.hidden_wind))


def replay(
    config: FlagConfig,
    witnesses: Targets,
    indices: Sequence[int],
    steps: int = 10,
    start: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Poses after each of the last `steps` steps when these witnesses are replayed, shape (steps, targets, ..., 3).

    Parameters
    ----------
    config, witnesses, indices
        The task, whose control acts, and which witnesses.
    steps
        How many of the last steps to give.
    start : (targets, layers, rows, cols, 3)
        Positions to start from [m]; None: the scene's own.

    Raises
    ------
    ValueError
        If the scene does not survive a witness.
    """
    batch = FlagBatch(replace(config, targets=witnesses), len(indices))
    batch.reset(range(len(indices)), indices, np.zeros((len(indices), *batch.scene.lattice.shape, 3)))
    if start is not None:
        batch.simulator.set_positions(start)
    actions = np.stack([witnesses.actions(index) for index in indices], axis=1).astype(np.float64)
    poses: list[NDArray[Any]] = []
    for number, row in enumerate(actions):
        batch.step(row, row.shape)
        if batch.diverged.any():
            raise ValueError(
                f"scene must survive the witness of its targets; that of target {indices[int(np.argmax(batch.diverged))]} takes "
                f"the flag out of {LARGEST_COORDINATE:g} m or of the finite numbers before t = {batch.simulator.time:.6g} s"
            )
        if number >= len(actions) - steps:
            poses.append(batch.now.positions.copy())
    return np.stack(poses)
