"""One flag's episode, taken out of a batch and put into another, to the bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.envs.batch import FlagBatch
from flag_env.physics import State

Array = NDArray[np.float64]

_OWN = (
    "target_index", "hidden_wind", "_targets", "_ahead", "_mast_target", "before", "distance", "success", "diverged", "elapsed",
    "held", "observed",
)  # fmt: skip
"""Arrays of a batch that an episode depends on, besides its simulator and actuators."""


@dataclass(frozen=True)
class EpisodeState:
    """One flag's episode, to the bit: simulator, actuators, target and counters."""

    simulator: State
    control: tuple[Array, ...]
    own: tuple[NDArray[Any], ...]
    frame: tuple[Array, Array]


def get_state(batch: FlagBatch, copy: int) -> EpisodeState:
    """Everything that one flag's episode depends on."""
    own = tuple(getattr(batch, name)[copy].copy() for name in _OWN)
    frame = batch.now.x[copy].copy(), batch.now.v[copy].copy()
    return EpisodeState(batch.simulator.get_state().only(copy), batch.control.get_state(copy), own, frame)


def set_state(batch: FlagBatch, copies: Sequence[int], state: EpisodeState) -> None:
    """Let the episodes of `copies` go on from what `get_state` found in a flag of the same task.

    Raises
    ------
    TypeError, ValueError
        If the state is none, or of another task; nothing has changed then.
    """
    if not isinstance(state, EpisodeState):
        raise TypeError(f"state must come from get_state(), got {state!r}")
    if [part.shape for part in state.own] != [getattr(batch, name).shape[1:] for name in _OWN]:
        raise ValueError("state must come from an environment of the same control, level, split and view")
    batch.simulator.set_state(state.simulator, copies=None if batch.copies == 1 else list(copies))
    for copy in copies:
        batch.control.set_state(copy, state.control)
        for name, value in zip(_OWN, state.own, strict=True):
            getattr(batch, name)[copy] = value
        batch.now.x[copy], batch.now.v[copy] = state.frame
    batch.follows = batch.goal.moving or batch.layout.ahead.stop > batch.layout.ahead.start
