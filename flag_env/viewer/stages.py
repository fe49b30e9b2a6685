"""The scenes that the page offers: each with the wind that it starts in, its pace, and the effects that may be added to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import Scene, Simulator, presets
from flag_env.physics.effects import AirPressure, Effect, Gusts, MastCollision, SelfCollision, StrainLimit, Tearing

Vector = tuple[float, float, float]

STILL: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Breeze:
    """A wind in the unit of the scene's own: mean + amplitude cos(phase + frequency t), as `Simulator.set_wind` takes it."""

    mean: Vector = STILL
    amplitude: Vector = STILL
    frequency: Vector = STILL


@dataclass(frozen=True)
class Stage:
    """A scene as it is shown.

    Attributes
    ----------
    title, told
        Its name, and what it shows in a few words.
    make
        Makes the scene.
    breeze
        The wind in it; accelerations [m/s^2] where the scene's wind is a force, which then counts for the mast-side mass.
    pace
        Simulated seconds that a second on the screen shows.
    extra
        Effects that are off and may be put on.
    """

    title: str
    told: str
    make: Callable[[], Scene]
    breeze: Breeze = Breeze()
    pace: float = 1.0
    extra: tuple[Effect, ...] = ()


_AIR = (AirPressure(), Gusts(), SelfCollision(), MastCollision(), StrainLimit(), Tearing())
_SOLID = (StrainLimit(), Tearing())
_REPORT = Breeze(amplitude=(4800.0, 1150.0, 5700.0), frequency=(0.4, 0.5, 3.5))

STAGES: dict[str, Stage] = {
    "rope": Stage("Rope", "one coordinate, plucked", partial(presets.rope, 24), pace=0.05, extra=_SOLID),
    "rope-free": Stage("Rope, free end", "plucked", partial(presets.rope, 24, pinned="edge"), pace=0.05, extra=_SOLID),
    "sheet": Stage(
        "Sheet", "two coordinates, in its plane", presets.sheet,
        Breeze((3.5, 0.0, 0.0), (2.5, 0.0, 2.0), (2.0, 0.0, 3.1)), extra=_SOLID,
    ),
    "flag": Stage(
        "Flag", "a breeze that swings", presets.flag, Breeze((4.0, 0.0, 0.0), (2.5, 4.0, 1.5), (1.1, 3.3, 2.0)), extra=_AIR,
    ),
    "two-layer": Stage(
        "Two layers", "struts and cube diagonals", presets.two_layer_flag,
        Breeze((4.0, 0.0, 0.0), (2.5, 4.0, 1.5), (1.1, 3.3, 2.0)), extra=_AIR,
    ),
    "storm": Stage(
        "Storm", "turbulent air, cloth against cloth", partial(presets.storm_flag, dtype="float32"),
        Breeze(mean=(8.0, 0.0, 0.0)), extra=_SOLID,
    ),
    "report-1": Stage(
        "Report, one layer", "the report's units and wind", presets.report_flag, _REPORT, pace=0.1, extra=_SOLID,
    ),
    "report-2": Stage(
        "Report, two layers", "no shear links", partial(presets.report_flag, 2), _REPORT, pace=0.1, extra=_SOLID,
    ),
}  # fmt: skip
"""By the names that the page and the command take."""


def start(scene: Scene, seed: int = 0) -> Simulator:
    """A simulator of the scene at rest; a rope drawn aside."""
    simulator = Simulator(scene, seed=seed)
    if scene.lattice.dimensions == 1:
        simulator.set_positions(_plucked(scene))
    return simulator


def _plucked(scene: Scene) -> NDArray[np.float64]:
    """The rope drawn aside at a third of its length; beyond, level where its end is free."""
    positions = scene.lattice.rest_positions.copy()
    x = positions[..., 0] / positions[..., 0].max()
    down = (1.0 - x) / 0.7 if scene.lattice.fixed[-1] else np.ones_like(x)
    positions[..., 2] = 0.3 * positions[..., 0].max() * np.minimum(x / 0.3, down)
    return positions
