"""From an episode to a frame: makes the renderer when the first frame is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.envs.registration import load_env_creator
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from flag_env.envs.batch import FlagBatch
from flag_env.envs.config import EPISODE_STEPS
from flag_env.render import Renderer, Snapshot

WIND_SCALE = 15.0
"""Wind acceleration that is drawn as an arrow of full length [m/s^2]."""


class Picture:
    """Draws the flags of a batch, `width` x `height` pixels."""

    def __init__(self, width: int, height: int) -> None:
        self._size = width, height
        self._renderer: Renderer | None = None

    def draw(self, batch: FlagBatch, copy: int = 0) -> NDArray[np.uint8]:
        """One frame, shape (height, width, 3)."""
        if self._renderer is None:
            self._renderer = Renderer(*self._size)  # matplotlib loads here
        return self._renderer.draw(snapshot(batch, copy))

    def close(self) -> None:
        """Free the renderer; the next frame makes another."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}


class LivePage:
    """Shows the flag of a batch in a browser while it moves: the room of pages is loaded when the first picture is to be seen."""

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._window: Any = None

    def show(self, batch: FlagBatch, terms: dict[str, float] | None) -> None:
        """The flag now, with the rewards of its step; None begins an episode.

        Raises
        ------
        DependencyNotInstalled
            If the extra "play" is missing.
        """
        if self._window is None:
            window: Any = load_env_creator(
                "flag_env.viewer:Window"
            )  # a room above this one, found as gymnasium finds environments
            try:
                self._window = window(batch.scene, self._fps, "episode", EPISODE_STEPS)
            except ImportError as error:
                raise DependencyNotInstalled(str(error)) from error
        self._window.show(snapshot(batch), terms)

    def close(self) -> None:
        """Close the page; the next picture opens another."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_window": None}


def snapshot(batch: FlagBatch, copy: int = 0) -> Snapshot:
    """The immutable picture of one flag of a batch."""
    lattice = batch.scene.lattice
    positions = batch.now.positions[copy]
    length, height = lattice.extent
    # The cloth may be blown to any side of the mast; a mast that moves takes it along and tilts. Room above is the wind sign's.
    away = 1.04 * length + 1.35 * batch.control.mast_range
    low = np.array([-away, -away, -0.6 * length - 1.95 * batch.control.mast_range])
    high = np.array([away, away, 1.8 * height + 1.8 * batch.control.mast_range])
    return Snapshot(
        positions=positions,
        mast=positions[0, [0, -1], 0],
        bounds=np.stack([low, high]),
        target=batch.target[copy],
        wind=batch.wind(copy),
        wind_scale=WIND_SCALE,
        success=bool(batch.distance[copy] < batch.config.tolerance),
        distance=float(batch.distance[copy]),
        tolerance=batch.config.tolerance,
        intact=batch.simulator.intact_cells()[copy] if any(effect.breaks for effect in batch.scene.effects) else None,
    )
