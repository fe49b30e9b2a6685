"""A run that flies: building it, carrying one's motion over to the next, and what to go back to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import Simulator, State
from flag_env.physics.diagnostics import strain
from flag_env.physics.limits import limited_by, max_timestep
from flag_env.viewer.settings import Settings
from flag_env.viewer.stages import start

Vector = NDArray[np.float64]

PROBATION = 1.0
"""Time that a flag must have flown before its state counts as good [s on the screen]."""

LARGEST_STRAIN = 5.0
"""Of a state that counts as good."""


@dataclass
class Running:
    """A simulator with what is known about it."""

    settings: Settings
    simulator: Simulator
    limit: float
    limited_by: str
    age: float = 0.0
    """For how long it has flown [s on the screen]."""
    keep_at: float = PROBATION
    """Age at which its state is next kept as a good one."""


@dataclass(frozen=True)
class Good:
    """Where to go back to."""

    running: Running
    settings: Settings
    state: State
    pose: Vector


def build(settings: Settings) -> Running:
    """The run that the settings ask for, compiled and at its start; takes a moment, and seconds where it must compile.

    Raises
    ------
    ValueError
        If the settings are refused.
    """
    scene = settings.scene()
    simulator = start(scene)
    fresh = simulator.get_state()
    simulator.step(1)
    _ = simulator.velocities
    simulator.set_state(fresh)
    limit = max_timestep(scene)
    return Running(settings, simulator, limit, limited_by(scene) if 0.0 < limit < math.inf else "")


def carry(old: Simulator, new: Simulator, pose: Vector) -> None:
    """Go on in `new` from where `old` is: positions, velocities, mast, and the state of every effect that both have alike."""
    new.set_positions(old.positions)
    new.set_velocities(old.velocities)
    new.set_mast(pose[:3], pose[3:])
    before, after = old.get_state(), new.get_state()
    known = dict(zip((effect.key for effect in old.scene.effects), before.effects, strict=True))
    effects = tuple(
        group if _alike(group := known.get(effect.key, ()), own) else own
        for effect, own in zip(new.scene.effects, after.effects, strict=True)
    )
    new.set_state(replace(after, time=before.time, effects=effects))


def in_shape(simulator: Simulator) -> bool:
    """Whether no link is stretched beyond all measure, as shortly before a divergence."""
    return bool(np.abs(strain(simulator.scene.lattice, simulator.positions)).max(initial=0.0) < LARGEST_STRAIN)


def _alike(some: tuple[Any, ...], others: tuple[Any, ...]) -> bool:
    return [(a.shape, a.dtype) for a in some] == [(b.shape, b.dtype) for b in others]
