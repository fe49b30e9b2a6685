"""Where the targets of a split are, step by step: given, or replayed from their witnesses at first use.

What is replayed in a level's own scene is kept on disk beside the compiled code, under a digest of everything that it depends on:
witnesses, hidden winds and scene, the sources of the package and the versions of Numba and NumPy. It is mapped, not read.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from flag_env._files import replacing
from flag_env.envs.config import DEFAULT_SCENE, EPISODE_STEPS, FlagConfig
from flag_env.physics.compiling import cache_root, source_digest
from flag_env.tasks import Targets

Replay = Callable[..., NDArray[np.float64]]

_CHUNK = 64


class Frames:
    """Positions of targets [m], a frame a step where they move, else one.

    Parameters
    ----------
    config
        The task.
    replay
        `envs.batch.replay`, which stands above this file.
    """

    def __init__(self, config: FlagConfig, replay: Replay) -> None:
        self._config, self._replay = config, replay
        self._known: NDArray[Any] | None = None
        self.count = EPISODE_STEPS if config.task.goal.moving else 1
        self._found: dict[int, NDArray[Any]] = {}

    def at(self, targets: Sequence[int] | NDArray[np.int64], steps: Any, coordinates: Any = slice(None)) -> NDArray[np.float64]:
        """Flat positions (targets, 3 particles) of these targets after these steps, from 0 on; the last pose stays for ever.

        With `coordinates`, and `steps` (targets, n, 1): those coordinates alone, (targets, n, coordinates).
        """
        rows = np.minimum(steps, self.count - 1)
        known = self._all()
        if known is not None:
            return np.asarray(known[np.asarray(targets).reshape(-1, *[1] * (np.ndim(rows) - 1)), rows, coordinates], np.float64)
        chosen = [self._of(int(target)) for target in targets]
        number = np.arange(len(chosen)).reshape(-1, *[1] * (np.ndim(rows) - 1))
        return np.asarray(np.stack(chosen)[number, rows, coordinates])

    def all(self) -> NDArray[Any]:
        """Frames of every target of the split, (targets, frames, 3 particles)."""
        known = self._all()
        return np.stack([self._of(target) for target in range(len(self._config.library))]) if known is None else known

    def _of(self, target: int) -> NDArray[np.float64]:
        """Frames of one target in a scene of the user's own."""
        if target not in self._found:
            self._found[target] = self._replayed([target])[0]
        return self._found[target]

    def _replayed(self, targets: Sequence[int]) -> NDArray[np.float64]:
        poses = self._replay(self._config, self._config.library, targets, self.count)
        return poses.reshape(self.count, len(targets), -1).swapaxes(0, 1)

    def _all(self) -> NDArray[Any] | None:
        """Frames of the whole split, if they are given or kept."""
        if self._known is None:
            config, library = self._config, self._config.library
            scene = config.resolved_scene()
            if library.positions.size and scene == DEFAULT_SCENE:
                self._known = library.positions.reshape(len(library), 1, -1)
            elif config.targets is None and scene == replace(config, scene=None, accuracy=None).resolved_scene():
                self._known = self._kept()
        return self._known

    def _kept(self) -> NDArray[np.float32]:
        """Frames of a split that ships witnesses alone, from disk or replayed and kept there; float32 holds them exactly."""
        library, root = self._config.library, cache_root()
        shape = (len(library), self.count, 3 * self._config.resolved_scene().lattice.size)
        path = None if root is None else root / "targets" / f"{self._digest(library)}.npy"
        if path is not None and path.exists():
            try:
                found: NDArray[np.float32] = np.load(path, mmap_mode="r")
                if found.shape == shape and found.dtype == np.float32:
                    return found
            except (OSError, ValueError):
                pass  # damaged, and made anew
        chunks = [range(first, min(first + _CHUNK, len(library))) for first in range(0, len(library), _CHUNK)]
        found = np.concatenate([self._replayed(chunk).astype(np.float32) for chunk in chunks])
        return found if path is None else self._keep(path, found)

    @staticmethod
    def _keep(path: Path, found: NDArray[np.float32]) -> NDArray[np.float32]:
        """Write the file whole, where that is possible, and map it."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as partial, partial.open("wb") as file:
                np.save(file, found)
            mapped: NDArray[np.float32] = np.load(path, mmap_mode="r")
        except OSError:
            return found
        return mapped

    def _digest(self, library: Targets) -> str:
        config = self._config
        control = config.control_type
        asked = f"{source_digest()} {numba.__version__} {np.__version__} {platform.machine()} {config.resolved_scene()!r}"
        settings = sorted((name, repr(getattr(control, name))) for name in dir(control) if name in _RANGES)
        made = hashlib.sha256(f"{asked} {control.__qualname__} {settings} {self.count} {library.own_turbulence}".encode())
        for array in (library.witnesses, library.spans, library.wind):
            made.update(np.ascontiguousarray(array).tobytes())
        return made.hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_known": None}


_RANGES = ("gain", "frequency", "fastest", "speed", "reach", "lag")
"""What a control has that its actions are scaled by."""
