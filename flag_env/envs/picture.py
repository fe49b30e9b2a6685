"""From an episode to a frame: makes the renderer when the first frame is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flag_env.envs.batch import FlagBatch
from flag_env.render.snapshot import Snapshot

if TYPE_CHECKING:
    from flag_env.render.renderer import Renderer

WIND_SCALE = 15.0
"""Wind acceleration that is drawn as an arrow of full length [m/s^2]."""


class Picture:
    """Draws the flags of a batch, `width` x `height` pixels."""

    def __init__(self, width: int, height: int) -> None:
        for name, value in (("width", width), ("height", height)):
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 16 <= value <= 8192:
                raise ValueError(f"{name} must be a whole number of pixels from 16 to 8192, got {value!r}")
        self._size = width, height
        self._renderer: Renderer | None = None

    def draw(self, batch: FlagBatch, copy: int = 0) -> NDArray[np.uint8]:
        """One frame, shape (height, width, 3)."""
        if self._renderer is None:
            from flag_env.render.renderer import Renderer  # matplotlib loads here

            self._renderer = Renderer(*self._size)
        return self._renderer.draw(snapshot(batch, copy))

    def close(self) -> None:
        """Free the renderer; the next frame makes another."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}


def snapshot(batch: FlagBatch, copy: int = 0) -> Snapshot:
    """The immutable picture of one flag of a batch."""
    lattice = batch.scene.lattice
    positions = batch.now.positions[copy]
    length, height = lattice.extent
    reach = 0.35 * lattice.diagonal if batch.settings.control == "wind" else 0.35 * lattice.diagonal + 1.0
    low = np.array([-reach, -0.75 * lattice.diagonal, -0.4 * lattice.diagonal - reach])
    high = np.array([length + reach, 0.75 * lattice.diagonal, height + reach])
    return Snapshot(
        positions=positions,
        mast=positions[0, [0, -1], 0],
        bounds=np.stack([low, high]),
        target=batch.target[copy],
        wind=batch.wind(copy),
        wind_scale=WIND_SCALE,
        success=bool(batch.distance[copy] < batch.settings.tolerance),
        distance=float(batch.distance[copy]),
        tolerance=batch.settings.tolerance,
    )
