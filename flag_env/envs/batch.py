"""Episodes of many flags in lock-step: what the single and the vector environments share, so that they agree bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.control import CONTROLS, Control
from flag_env.control.base import CONTROL_STEP
from flag_env.control.wind import wind_of
from flag_env.envs import glance
from flag_env.physics import Diverged, Scene, Simulator, presets, validate
from flag_env.physics.effects import Wind
from flag_env.physics.integrators import LFAB
from flag_env.physics.reading import Reading
from flag_env.physics.stability import timestep_of
from flag_env.physics.tuning import on_frames
from flag_env.tasks.targets import SPLITS, Targets, load_targets

Array = NDArray[np.float64]
Look = Callable[[int, int], None]

LEVELS = ("calm", "breeze")
"""calm: the wind is known; breeze: each target comes with a hidden wind that the agent must feel through the flag."""

EPISODE_STEPS = 75
HOLD_STEPS = 10
"""Steps in a row within tolerance that count as success."""

WIND = np.array([6.0, 0.0, 0.0])
"""Wind acceleration that is always there [m/s^2]."""

OBSERVED = (3, 5)
"""Rows and columns of the observed nodes."""

ROOM = 100.0
"""Largest coordinate of a flag that still counts as simulated [m]."""

FASTEST = float(np.finfo(np.float64).max)
"""Largest component of a velocity that still counts as simulated [m/s]."""

_SINGLE = np.dtype(np.float32)

LIMIT = 100.0
"""Bound of every entry of an observation."""

SCENES = ("flag", "two_layer_flag")


@dataclass(frozen=True)
class Settings:
    """The environments' arguments, checked; see `FlagEnv` for their meaning."""

    control: str = "wind"
    level: str = "breeze"
    split: str = "train"
    scene: Scene | str = "flag"
    tolerance: float = 0.05
    accuracy: str | float | None = None

    def __post_init__(self) -> None:
        validate.choice("control", self.control, CONTROLS)
        validate.choice("level", self.level, LEVELS)
        validate.choice("split", self.split, SPLITS)
        object.__setattr__(self, "tolerance", validate.number("tolerance", self.tolerance, above=0.0))
        if not isinstance(self.scene, Scene):
            validate.choice("scene", self.scene, SCENES)
        elif self.scene.lattice.dimensions < 3:
            raise ValueError(
                f"scene must have three dimensions, as its targets have, got dimensions={self.scene.lattice.dimensions}"
            )
        CONTROLS[self.control].check(self.resolved_scene())

    def resolved_scene(self) -> Scene:
        """The scene to simulate, tuned to the accuracy, its timestep a whole fraction of the control step."""
        scene = self.scene if isinstance(self.scene, Scene) else _preset(self.scene)
        if self.accuracy is None:  # a preset is "balanced" as it is
            return fitted(scene)
        return fitted(scene.tuned(self.accuracy))


def fitted(scene: Scene) -> Scene:
    """The scene with its timestep lowered to a whole fraction of the control step."""
    return on_frames(scene, timestep_of(scene))


def _preset(name: str) -> Scene:
    return getattr(presets, name)(rows=10, cols=16, integrator=LFAB(), dtype="float32")  # type: ignore[no-any-return]


DEFAULT_SCENE = fitted(_preset("flag"))
"""The scene of the shipped targets."""


class FlagBatch:
    """Many flags, each in an episode of its own.

    What a step leads to stands in the attributes until the next step or reset, which write over it.

    Parameters
    ----------
    settings
        The task.
    copies
        Number of flags.
    threads
        See `Simulator`.
    library
        The targets; None: the shipped ones.

    Attributes
    ----------
    now : Reading
        Positions and velocities.
    before, distance : (copies,)
        RMS distance to the target / flag diagonal, before and after the step.
    success : (copies,)
        Whether the flag has been within tolerance for ten steps.
    diverged : (copies,)
        Whether the simulation left the finite numbers, or the room; the flag then shows its last state that had not.
    observed : (copies, entries) float32
        Nodes' positions, velocities, targets, differences, actuators, time left.
    rows : list of (entries,) float32
        The same, and the same memory, of each flag.
    """

    _look_at_now: Look
    _look_at_last: Look

    def __init__(self, settings: Settings, copies: int = 1, threads: int | None = None, library: Targets | None = None) -> None:
        self.settings = settings
        scene = settings.resolved_scene()
        self.scene = scene
        self.simulator = Simulator(scene, copies, threads=threads)
        self.steps_per_action = round(CONTROL_STEP / self.simulator.timestep)
        self.control: Control = CONTROLS[settings.control](scene, copies)
        self.library = library or load_targets(settings.control, settings.level, settings.split)
        self._targets = np.zeros((copies, 3 * scene.lattice.size))
        self.target_index = np.zeros(copies, np.int64)
        self.hidden_wind = np.zeros((copies, 3))
        self.now, self._last = self.simulator.reading(), self.simulator.reading()
        self.before, self.distance = np.zeros(copies), np.zeros(copies)
        self.success, self.diverged = np.zeros(copies, bool), np.zeros(copies, bool)
        self.elapsed, self.held = np.zeros(copies, np.int64), np.zeros(copies, np.int64)
        self._start = Simulator(scene).get_state()
        self._start_positions = Simulator(scene).positions.reshape(-1)
        self.nodes = _observed_nodes(scene)
        self.diagonal = scene.lattice.diagonal
        entries = 12 * len(self.nodes) + self.control.state_size + 1
        self.observed = np.zeros((copies, entries), _SINGLE)
        self._shipped = scene == DEFAULT_SCENE
        self._poses: dict[int, Array] = {}
        self._windy = any(isinstance(effect, Wind) for effect in scene.effects)
        self._bind()

    @property
    def copies(self) -> int:
        """Number of flags."""
        return self.simulator.copies

    @property
    def target(self) -> Array:
        """Target positions [m], shape (copies, layers, rows, cols, 3)."""
        return self._targets.reshape(self.now.shape)

    def reset(self, copies: Sequence[int], chosen: Sequence[int], poses: Array | None = None) -> None:
        """Start an episode of each of `copies` with the target of the number in `chosen`, or the given target poses."""
        which = np.asarray(copies, np.intp)
        if poses is None:
            poses = self.poses(chosen)
        self.simulator.set_state(self._start, copies=None if len(which) == self.copies else [int(copy) for copy in which])
        self.control.reset(self.simulator, which)
        self.target_index[which] = chosen
        self._targets[which] = poses.reshape(len(which), -1)
        self.hidden_wind[which] = self.library.wind[chosen]
        self._set_ambient_wind()
        self.elapsed[which] = 0
        self.held[which] = 0
        self.success[which] = self.diverged[which] = False
        self.now.x[which], self.now.v[which] = self._start_positions, 0.0
        self._look(self.now, self._last, stepped=False)(0, self.copies)

    def step(self, action: Any, shape: tuple[int, ...]) -> None:
        """Take one control step under an action of `shape`, copies x size entries, clipped to [-1, 1].

        Raises
        ------
        ValueError
            If the action is of another shape or not finite; nothing has changed then.
        """
        if not self.control.apply(self.simulator, _shaped(action, shape)):
            raise _not_finite(action)
        self.now, self._last = self._last, self.now
        self._look_at_now, self._look_at_last = self._look_at_last, self._look_at_now
        self.simulator.step_into(self.steps_per_action, self.now, self._look_at_now)

    def wind(self, copy: int = 0) -> Array | None:
        """Wind acceleration on the flag now (x, y, z) [m/s^2]; None in a scene without wind."""
        wind = self.simulator.wind()
        return None if wind is None else wind[copy] / wind_of(self.scene, np.ones(3))

    def poses(self, chosen: Sequence[int]) -> Array:
        """Target poses of these numbers [m]: as shipped; in another scene than the default, where their witnesses lead there."""
        if self._shipped:
            return np.asarray(self.library.positions[list(chosen)])
        for index in chosen:
            if index not in self._poses:
                self._poses[index] = replay(self.settings, self.library, [index])[-1, 0]
        return np.stack([self._poses[index] for index in chosen])

    def _bind(self) -> None:
        """Tie machine code to the batch's arrays, and rows to `observed`."""
        self._look_at_now = self._look(self.now, self._last, stepped=True)
        self._look_at_last = self._look(self._last, self.now, stepped=True)
        self.rows = list(self.observed)

    def _look(self, now: Reading, last: Reading, stepped: bool) -> Look:
        """Function that looks at the flags from a first to before a last, which have taken a step or not."""
        return partial(
            glance.look(), now.x, now.v, last.x, last.v, self._targets, self.nodes, self.control.state,
            ROOM, FASTEST, self.diagonal, self.control.close * self.diagonal, self.settings.tolerance, HOLD_STEPS, EPISODE_STEPS,
            LIMIT, self.elapsed, self.held, self.before, self.distance, self.success, self.diverged, self.observed, stepped,
        )  # fmt: skip

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_look_at_now": None, "_look_at_last": None, "rows": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bind()

    def _set_ambient_wind(self) -> None:
        if self._windy:
            self.simulator.set_wind(mean=wind_of(self.scene, WIND + self.hidden_wind))


def check_action(action: Any, shape: tuple[int, ...]) -> None:
    """Raise the ValueError of `FlagBatch.step`, if any."""
    if not np.isfinite(_shaped(action, shape)).all():
        raise _not_finite(action)


def _shaped(action: Any, shape: tuple[int, ...]) -> NDArray[np.floating[Any]]:
    given = action if type(action) is np.ndarray and action.dtype is _SINGLE else np.asarray(action, np.float64)
    if given.shape != shape:
        raise ValueError(f"action must have the shape {shape}, got {given.shape}")
    return given


def _not_finite(action: Any) -> ValueError:
    return ValueError(f"action must be finite, got {action!r}")


def _observed_nodes(scene: Scene) -> NDArray[np.int64]:
    """Flat numbers of the observed particles: evenly spread over layer 0, the mast's column left out."""
    _, rows, cols = scene.lattice.shape
    row = np.rint(np.linspace(0, rows - 1, OBSERVED[0])).astype(np.int64)
    col = np.rint(np.linspace(min(1, cols - 1), cols - 1, OBSERVED[1])).astype(np.int64)
    return (row[:, None] * cols + col).ravel()


def replay(settings: Settings, witnesses: Targets, indices: Sequence[int]) -> Array:
    """Poses after each of the last `HOLD_STEPS` steps when these witnesses are replayed, shape (steps, targets, ..., 3).

    Raises
    ------
    Diverged
        If the scene does not survive a witness.
    """
    batch = FlagBatch(settings, len(indices), library=witnesses)
    batch.reset(range(len(indices)), indices, np.zeros((len(indices), *batch.scene.lattice.shape, 3)))
    actions = np.stack([witnesses.actions(index) for index in indices], axis=1).astype(np.float64)
    poses = []
    for row in actions:
        batch.step(row, row.shape)
        if batch.diverged.any():
            raise Diverged(batch.simulator.time, int(np.argmax(batch.diverged)), (0, 0, 0))
        poses.append(batch.now.positions.copy())
    return np.stack(poses[-HOLD_STEPS:])
