"""Episodes of many flags in lock-step: what the single and the vector environments share, so that they agree bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.control import CONTROL_STEP, CONTROLS, Control, WindControl, wind_of
from flag_env.envs import evaluate
from flag_env.physics import Frame, Scene, Simulator, presets, tune
from flag_env.physics.accuracy import divided
from flag_env.physics.effects import CosineWind, Wind
from flag_env.physics.integrators import LFAB
from flag_env.tasks import SPLITS, Targets, load_targets

Array = NDArray[np.float64]
Evaluation = Callable[[int, int], None]

LEVELS = ("calm", "breeze")
"""calm: the wind is known; breeze: each target comes with a hidden wind that the agent must feel through the flag."""

EPISODE_STEPS = 75
HOLD_STEPS = 10
"""Steps in a row within tolerance that count as success."""

WIND = np.array([6.0, 0.0, 0.0])
"""Wind acceleration that is always there [m/s^2]."""

OBSERVED = (3, 5)
"""Rows and columns of the observed nodes."""

LARGEST_COORDINATE = 100.0
"""Largest coordinate of a flag that still counts as simulated [m]."""

LARGEST_SPEED = float(np.finfo(np.float64).max)
"""Largest component of a velocity that still counts as simulated [m/s]."""

_SINGLE = np.dtype(np.float32)

LIMIT = 100.0
"""Bound of every entry of an observation."""

SCENES = ("flag", "two_layer_flag")


@dataclass(frozen=True)
class FlagConfig:
    """The environments' arguments, checked; see `FlagEnv` for their meaning."""

    control: str = "wind"
    level: str = "breeze"
    split: str = "train"
    scene: Scene | str = "flag"
    tolerance: float = 0.05
    accuracy: str | float | None = None

    def __post_init__(self) -> None:
        _validate.choice("control", self.control, CONTROLS)
        _validate.choice("level", self.level, LEVELS)
        _validate.choice("split", self.split, SPLITS)
        object.__setattr__(self, "tolerance", _validate.number("tolerance", self.tolerance, above=0.0))
        if not isinstance(self.scene, Scene):
            _validate.choice("scene", self.scene, SCENES)
        elif self.scene.lattice.dimensions < 3:
            raise ValueError(
                f"scene must have three dimensions, as its targets have, got dimensions={self.scene.lattice.dimensions}"
            )
        elif (reach := float(np.linalg.norm(self.scene.lattice.rest_positions, axis=-1).max())) > LARGEST_COORDINATE:
            raise ValueError(
                f"scene must fit into {LARGEST_COORDINATE:g} m, got a flag whose far corner is {reach:g} m from its mast's foot"
            )
        CONTROLS[self.control].check(self.resolved_scene())

    def resolved_scene(self) -> Scene:
        """The scene to simulate, tuned to the accuracy, its timestep a whole fraction of the control step."""
        scene = self.scene if isinstance(self.scene, Scene) else _preset(self.scene)
        if self.accuracy is None:  # a preset is "balanced" as it is
            return divided(scene, CONTROL_STEP)
        if isinstance(self.accuracy, str):
            return tune(scene, self.accuracy, multiple_of=CONTROL_STEP)
        tuned = tune(blown(scene), self.accuracy, multiple_of=CONTROL_STEP)
        return scene.replace(integrator=tuned.integrator, dtype=tuned.dtype, timestep=tuned.timestep, allow_unstable=False)


def blown(scene: Scene) -> Scene:
    """The scene in the wind of full action from the start on; a scene without a wind gets one, for a mast shakes it as much.

    An accuracy in metres is kept in this motion, since a calm flag's own says little of an episode's.
    """
    winds = [effect for effect in scene.effects if isinstance(effect, Wind)] or [CosineWind()]
    scene = scene.adding(*winds)
    mean, amplitude = (tuple(wind_of(scene, part).tolist()) for part in (WIND, WindControl.gain))
    full = {"mean": mean, "amplitude": amplitude, "frequency": tuple(WindControl.frequency.tolist())}
    return scene.adding(*(replace(wind, **full) for wind in winds))  # type: ignore[arg-type]


def _preset(name: str) -> Scene:
    return getattr(presets, name)(rows=10, cols=16, integrator=LFAB(), dtype="float32")  # type: ignore[no-any-return]


DEFAULT_SCENE = divided(_preset("flag"), CONTROL_STEP)
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
    episode_steps
        Length of an episode, of which an agent sees the share that is left.

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

    _evaluate_now: Evaluation
    _evaluate_last: Evaluation

    def __init__(
        self,
        config: FlagConfig,
        copies: int = 1,
        threads: int | None = None,
        library: Targets | None = None,
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        self.config, self.episode_steps = config, episode_steps
        scene = config.resolved_scene()
        self.scene = scene
        self.simulator = Simulator(scene, copies, threads=threads)
        self.steps_per_action = round(CONTROL_STEP / self.simulator.timestep)
        self.control: Control = CONTROLS[config.control](scene, copies)
        self.library = library or load_targets(config.control, config.level, config.split)
        self._targets = np.zeros((copies, 3 * scene.lattice.size))
        self.target_index = np.zeros(copies, np.int64)
        self.hidden_wind = np.zeros((copies, 3))
        self.now, self._last = self.simulator.frame(), self.simulator.frame()
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
        seeds = [int(generator.integers(2**63)) for generator in generators] if self.simulator.turbulent else None
        self.reset(copies, chosen, seeds=seeds)

    def reset(
        self, copies: Sequence[int], chosen: Sequence[int], poses: Array | None = None, seeds: Sequence[int] | None = None
    ) -> None:
        """Start an episode of each of `copies` with the target of the number in `chosen`, or the given target poses.

        Turbulence starts from `seeds`; None: the same for all, in which witnesses are replayed.
        """
        which = np.asarray(copies, np.intp)
        if poses is None:
            poses = self.poses(chosen)
        if len(which) == self.copies:
            self.simulator.set_state(self._start)
        else:  # factors of set_parameters are those of all flags, and stay
            self.simulator.set_state(replace(self._start, scales=self.simulator.scales), copies=which.tolist())
        if seeds is not None:
            self.simulator.reseed(which.tolist(), seeds)
        self.control.reset(self.simulator, which)
        self.target_index[which] = chosen
        self._targets[which] = poses.reshape(len(which), -1)
        self.hidden_wind[which] = self.library.wind[chosen]
        self._set_ambient_wind()
        self.elapsed[which] = 0
        self.held[which] = 0
        self.success[which] = self.diverged[which] = False
        self.now.x[which], self.now.v[which] = self._start_positions, 0.0
        self._evaluation(self.now, self._last, stepped=False)(0, self.copies)

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
        self._evaluate_now, self._evaluate_last = self._evaluate_last, self._evaluate_now
        self.simulator.step_into(self.steps_per_action, self.now, self._evaluate_now)

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
                self._poses[index] = replay(self.config, self.library, [index])[-1, 0]
        return np.stack([self._poses[index] for index in chosen])

    def _bind(self) -> None:
        """Tie machine code to the batch's arrays, and rows to `observed`."""
        self._evaluate_now = self._evaluation(self.now, self._last, stepped=True)
        self._evaluate_last = self._evaluation(self._last, self.now, stepped=True)
        self.rows = list(self.observed)

    def _evaluation(self, now: Frame, last: Frame, stepped: bool) -> Evaluation:
        """Function that looks at the flags from a first to before a last, which have taken a step or not."""
        return partial(
            evaluate.evaluate_step(), now.x, now.v, last.x, last.v, self._targets, self.nodes, self.control.state,
            LARGEST_COORDINATE, LARGEST_SPEED, self.diagonal, self.control.error_scale * self.diagonal, self.config.tolerance,
            HOLD_STEPS, self.episode_steps, LIMIT, self.elapsed, self.held, self.before, self.distance, self.success,
            self.diverged, self.observed, stepped,
        )  # fmt: skip

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_evaluate_now": None, "_evaluate_last": None, "rows": None}

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


def replay(config: FlagConfig, witnesses: Targets, indices: Sequence[int]) -> Array:
    """Poses after each of the last `HOLD_STEPS` steps when these witnesses are replayed, shape (steps, targets, ..., 3).

    Raises
    ------
    ValueError
        If the scene does not survive a witness.
    """
    batch = FlagBatch(config, len(indices), library=witnesses)
    batch.reset(range(len(indices)), indices, np.zeros((len(indices), *batch.scene.lattice.shape, 3)))
    actions = np.stack([witnesses.actions(index) for index in indices], axis=1).astype(np.float64)
    poses = []
    for row in actions:
        batch.step(row, row.shape)
        if batch.diverged.any():
            raise ValueError(
                f"scene must survive the witness of its targets; that of target {indices[int(np.argmax(batch.diverged))]} takes "
                f"the flag out of {LARGEST_COORDINATE:g} m or of the finite numbers before t = {batch.simulator.time:.6g} s"
            )
        poses.append(batch.now.positions.copy())
    return np.stack(poses[-HOLD_STEPS:])
