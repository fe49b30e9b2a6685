"""The environments' arguments, checked once for all of them, and the scene that they stand for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from flag_env import _validate
from flag_env.control import CONTROL_STEP, CONTROLS, Control, WindControl, wind_of
from flag_env.physics import Scene, presets, tune
from flag_env.physics.accuracy import divided
from flag_env.physics.effects import CosineWind, Wind
from flag_env.physics.integrators import LFAB
from flag_env.render import LARGEST_SIZE, SMALLEST_SIZE
from flag_env.tasks import REWARDS, SPLITS, VIEWS, Level, Targets, checked_level, load_targets, read_targets

EPISODE_STEPS = 75

WIND = np.array([6.0, 0.0, 0.0])
"""Wind acceleration that is always there [m/s^2]."""

LARGEST_COORDINATE = 100.0
"""Largest coordinate of a flag that still counts as simulated [m]."""

SCENES = ("flag", "two_layer_flag")


@dataclass(frozen=True)
class FlagConfig:
    """The environments' arguments; see `FlagEnv` for their meaning.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, its value and what is allowed.
    """

    control: str | type[Control] = "wind"
    level: str | Level = "breeze"
    split: str = "train"
    scene: Scene | str | None = None
    tolerance: float = 0.05
    reward: str | None = None
    render_mode: str | None = None
    width: int = 480
    height: int = 480
    accuracy: str | float | None = None
    targets: Targets | str | Path | None = None
    view: str | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.control, type) and issubclass(self.control, Control)):
            _validate.choice("control", self.control, CONTROLS)
        level = checked_level(self.control, self.level)
        _validate.choice("split", self.split, SPLITS if self.targets is not None else level.sizes)
        if self.view is not None:
            _validate.choice("view", self.view, VIEWS)
        if self.seen == "mast" and self.control_type.mast_pose is None:
            raise ValueError(f"control must move the mast for view='mast', got {self.control!r}")
        object.__setattr__(self, "tolerance", _validate.number("tolerance", self.tolerance, above=0.0))
        if self.scene is None:
            pass
        elif not isinstance(self.scene, Scene):
            _validate.choice("scene", self.scene, SCENES)
        elif self.scene.lattice.dimensions < 3:
            raise ValueError(
                f"scene must have three dimensions, as its targets have, got dimensions={self.scene.lattice.dimensions}"
            )
        elif (far := float(np.linalg.norm(self.scene.lattice.rest_positions, axis=-1).max())) > LARGEST_COORDINATE:
            raise ValueError(
                f"scene must fit into {LARGEST_COORDINATE:g} m, got a flag whose far corner is {far:g} m from its mast's foot"
            )
        if self.reward is not None:
            _validate.choice("reward", self.reward, REWARDS)
        for name in ("width", "height"):
            pixels = getattr(self, name)
            if (
                isinstance(pixels, bool)
                or not isinstance(pixels, (int, np.integer))
                or not SMALLEST_SIZE <= pixels <= LARGEST_SIZE
            ):
                raise ValueError(
                    f"{name} must be a whole number of pixels from {SMALLEST_SIZE} to {LARGEST_SIZE}, got {pixels!r}"
                )
        if self.targets is not None and not isinstance(self.targets, (Targets, str, Path)):
            raise TypeError(f"targets must be Targets or the path of a library file, got {self.targets!r}")
        if self.targets is None and not (isinstance(self.control, str) and isinstance(self.level, str)):
            raise ValueError("targets must be given with a control or level of your own, got None")
        self.control_type.check(self.resolved_scene())

    @property
    def control_type(self) -> type[Control]:
        """The control's class."""
        if not isinstance(self.control, str):
            return self.control
        return checked_level(self.control, self.level).control or CONTROLS[self.control]

    @property
    def task(self) -> Level:
        """The level itself."""
        return checked_level(self.control, self.level)

    @property
    def seen(self) -> str:
        """Name of the view: the one asked for, or the level's."""
        return self.task.view if self.view is None else self.view

    @cached_property
    def library(self) -> Targets:
        """The targets of the split.

        Raises
        ------
        ValueError
            If they are not of the control's actions, of 75 steps, or, in the default scene, not of its shape.
        """
        if self.targets is None:
            found = load_targets(str(self.control), self.task.library or self.task.name, self.split)
            return replace(found, own_turbulence=True) if self.task.turbulent else found
        found = self.targets if isinstance(self.targets, Targets) else read_targets(Path(self.targets), self.split)
        if found.witnesses.shape[2] != self.control_type.size or found.spans.sum() != EPISODE_STEPS:
            raise ValueError(
                f"targets must have witnesses of {EPISODE_STEPS} steps of {self.control_type.size} entries, got "
                f"{int(found.spans.sum())} steps of {found.witnesses.shape[2]}"
            )
        return found

    def resolved_scene(self) -> Scene:
        """The scene to simulate, tuned to the accuracy, its timestep a whole fraction of the control step."""
        if self.scene is None:
            scene = self.task.scene or _preset("flag")
        else:
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
