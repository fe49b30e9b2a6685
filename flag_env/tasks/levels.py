"""Levels: which targets an agent gets, what is hidden from it, what it sees, and what counts.

A level of your own is one entry, or an object given to the environment together with targets of its own:
`gymnasium.make("Flag-v0", level=Level("gale", hidden_wind=(6.0, 8.0, 6.0)), targets=...)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.control import Control, MastControl, WindControl
from flag_env.physics import Scene, effects, integrators, presets
from flag_env.tasks.goals import HOLD, SNAP, WAVE, Goal
from flag_env.tasks.reward import REWARDS
from flag_env.tasks.witnesses import Sampler, Spline, Strokes

VIEWS = ("nodes", "sensors", "wave", "mast")
"""What an agent may see; see `ObservationLayout`."""

RELEASED_SIZES = (("train", 768), ("validation", 128), ("test", 128))
SIZES = (("train", 768), ("validation", 128), ("test", 512), ("shift", 128))
"""Splits and their numbers of targets."""


@dataclass(frozen=True)
class Level:
    """A level of difficulty.

    Attributes
    ----------
    name
        What it is called.
    hidden_wind
        Largest wind acceleration either way that comes with a target and is not shown (x, y, z) [m/s^2].
    controls
        Names of the controls that it has targets for.
    goal
        What counts as success.
    witness
        Draws witnesses; None: as the control does for poses that can be held.
    view
        What the agent sees, one of `VIEWS`.
    reward
        Name of the reward.
    control
        Class to act with in place of the one that the control's name stands for; None: that one.
    scene
        What is simulated; None: the flag.
    turbulent
        Whether the episodes of a target all have the turbulence of its witness.
    apart
        Least distance of targets to those of other splits, in tolerances of 5 %: RMS over the steps that count.
    library
        Name of the level whose targets it shares; None: it has its own.
    splits
        Names of the splits, each with its number of targets.
    """

    name: str
    hidden_wind: tuple[float, ...] = (0.0, 0.0, 0.0)
    controls: tuple[str, ...] = ()
    goal: Goal = HOLD
    witness: Sampler | None = None
    view: str = "nodes"
    reward: str = "shaped"
    control: type[Control] | None = None
    scene: Scene | None = None
    turbulent: bool = False
    apart: float = 2.0
    library: str | None = None
    splits: tuple[tuple[str, int], ...] = SIZES

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise TypeError(f"name must be a string, got {self.name!r}")
        object.__setattr__(self, "hidden_wind", _validate.vector("hidden_wind", self.hidden_wind))
        _validate.choice("view", self.view, VIEWS)
        _validate.choice("reward", self.reward, REWARDS)
        if not isinstance(self.goal, Goal):
            raise TypeError(f"goal must be a Goal, got {self.goal!r}")

    @property
    def shifted_wind(self) -> tuple[float, ...]:
        """Largest hidden wind of the split "shift": 1.5 times that of the others; where they hide none, half a breeze."""
        hidden = np.array(self.hidden_wind)
        return tuple((1.5 * hidden if hidden.any() else 0.5 * np.array(_BREEZE)).tolist())

    @property
    def sizes(self) -> dict[str, int]:
        """Number of targets of each split."""
        return dict(self.splits)


class StormControl(WindControl):
    """Wind control of 3 m/s either way, in air that moves."""

    gain: ClassVar[NDArray[np.float64]] = np.full(3, 4.5)


class WhipControl(MastControl):
    """Mast control twice as fast."""

    speed: ClassVar[NDArray[np.float64]] = 2.0 * MastControl.speed


def _storm() -> Scene:
    flag = presets.flag(rows=10, cols=16, integrator=integrators.LFAB(), dtype="float32")
    gusts = effects.Gusts(0.5, scale=5.0, speed=4.0)
    return (
        flag.without(effects.CosineWind).without(effects.AirDrag).adding(effects.AirPressure(mean=(4.0, 0.0, 0.0), gusts=gusts))
    )


_BREEZE = (3.0, 4.0, 3.0)

LEVELS = {
    level.name: level
    for level in (
        Level("calm", controls=("wind", "mast"), splits=RELEASED_SIZES),
        Level("breeze", _BREEZE, ("wind", "mast"), splits=RELEASED_SIZES),
        Level("sensors", _BREEZE, ("wind",), view="sensors", library="breeze", splits=RELEASED_SIZES),
        Level("wave", _BREEZE, ("wind", "both", "wind+frequency"), WAVE, Spline(7, 75), "wave", "track"),
        Level("snap", _BREEZE, ("wind",), SNAP, Strokes((15,) * 5), reward="snap", apart=0.0),
        Level("swing", controls=("mast",), goal=SNAP, witness=Strokes((22, 22, 21), rest=10), view="mast", reward="snap"),
        Level(
            "storm", (2.25, 2.25, 2.25), ("wind",), WAVE, Spline(7, 75), "wave", "track", StormControl, _storm(), turbulent=True
        ),
        Level("whip", (0.0,) * 3, ("mast",), SNAP, Strokes((15,) * 5), "mast", "snap", WhipControl),
    )
}
"""What the environments' `level` argument stands for, from solved to open."""


def rungs() -> list[tuple[str, str]]:
    """Control and level of every task that there are targets for."""
    return [(control, level.name) for level in LEVELS.values() for control in level.controls]


def checked_level(control: str | type[Control], level: str | Level) -> Level:
    """The level; raise ValueError unless there is one of this name, for a control given by its name with targets for it."""
    if isinstance(level, Level):
        return level
    known = [name for name, one in LEVELS.items() if not isinstance(control, str) or control in one.controls]
    return LEVELS[_validate.choice("level", level, known or LEVELS)]
