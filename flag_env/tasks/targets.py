"""The library of targets, each with its witness: the actions that reach it.

A target is the pose in which the flag ends, or the motion in which it moves, when its witness is replayed from the start under
the target's hidden wind and in its turbulence. `envs.certify` builds them from a seed; splits never share a witness. Poses of the
first levels are shipped for the default scene, rounded to 1/4096 m; of the others the witnesses, which `envs.frames` replays.
"""

from __future__ import annotations

import hashlib
import zipfile
import zlib
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.tasks.witnesses import unrolled

SPLITS = ("train", "validation", "test", "shift")

PARTS = ("witnesses", "wind", "positions")
"""Arrays that a library file has of each split; besides, `spans`, `seed` and a digest of each split."""

QUANTUM = 2.0**-12
"""Resolution of the stored positions [m]."""

LARGEST = 2**15 - 1
"""Largest coordinate that can be stored, in quanta."""


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of one control, level and split; those of your own are given to an environment as `targets`.

    Attributes
    ----------
    witnesses : (targets, knots, action) float32
        Actions; each knot is held for its share of the episode, as `spans` tells.
    spans : (knots,) or (1,)
        Number of steps of each knot; or of all of them, which are then joined by a cubic spline.
    wind : (targets, 3) float32
        Hidden wind [m/s^2], on top of the known one.
    positions : (targets, layers, rows, cols, 3)
        Poses of the default scene [m]; without any, of size 0, poses are where the witnesses lead.
    ends : (targets, nodes, 3)
        Where the nodes that an agent observes are in the end [m], of libraries that ship no poses: what replays must come to.
    own_turbulence
        Whether each target has turbulence of its own, that of its witness; else it differs from episode to episode.
    """

    witnesses: NDArray[np.float32]
    spans: NDArray[np.int64]
    wind: NDArray[np.float32]
    positions: NDArray[np.float64]
    ends: NDArray[np.float64] | None = None
    own_turbulence: bool = False

    def __len__(self) -> int:
        return len(self.witnesses)

    def actions(self, index: int) -> NDArray[np.float32]:
        """The witness of one target, an action a step, shape (steps, action)."""
        return unrolled(self.witnesses[index], self.spans)

    def turbulence_seed(self, index: int) -> int:
        """Seed of a target's turbulence: a digest of its witness and hidden wind, whatever its number."""
        made = hashlib.sha256(self.witnesses[index].tobytes() + self.wind[index].tobytes())
        return int.from_bytes(made.digest()[:7], "little")


@lru_cache(maxsize=32)
def load_targets(control: str, level: str, split: str) -> Targets:
    """The shipped targets of a control, level and split."""
    with as_file(files("flag_env.tasks") / "data" / f"{control}_{level}.npz") as path:
        return read_targets(path, split)


def read_targets(path: Path, split: str) -> Targets:
    """One split of a library file.

    Raises
    ------
    ValueError
        If the file is damaged, not whole, or not what its digest was made of.
    """
    seed, arrays = _read(path, (*(f"{split}_{name}" for name in PARTS), "spans", f"{split}_digest"))
    *parts, spans, noted = arrays
    if str(noted) != digest(seed, split, *parts, spans):
        raise ValueError(f"{path} must hold {split} targets that fit its digest, got others; build it anew with flag-env targets")
    witnesses, wind, positions = parts
    if positions.ndim == 3:
        return Targets(witnesses, spans, wind, np.zeros(0), QUANTUM * positions.astype(np.float64))
    return Targets(witnesses, spans, wind, decode(positions))


def read_seed(path: Path) -> int:
    """The seed that a library file was built from; a ValueError as from `read_targets`."""
    return _read(path, ())[0]


def digest(seed: int, split: str, *arrays: NDArray[Any]) -> str:
    """Hexadecimal digest of a split: its seed, and its arrays (`PARTS`, then the spans) with their types and shapes."""
    found = hashlib.sha256(f"{seed} {split}".encode())
    for array in arrays:
        found.update(f" {array.dtype.str} {array.shape} ".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()


def _read(path: Path, names: tuple[str, ...]) -> tuple[int, list[NDArray[Any]]]:
    """Seed and arrays of a file."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            return int(data["seed"]), [data[name] for name in names]
    except FileNotFoundError:
        raise
    except (OSError, KeyError, ValueError, EOFError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(
            f"{path} must be a whole library of targets, got {error}; build it anew with flag-env targets"
        ) from error


def encode(positions: NDArray[np.float64]) -> NDArray[np.int16]:
    """Whole multiples of the quantum, as differences along the columns and then the rows, which compress well."""
    whole = np.rint(positions / QUANTUM)
    if np.abs(whole).max() > LARGEST:
        raise ValueError(f"positions must lie within {LARGEST * QUANTUM:g} m of the origin, got {np.abs(positions).max():g} m")
    whole = whole.astype(np.int16)
    for axis in (3, 2):
        whole = np.diff(whole, axis=axis, prepend=np.int16(0))
    return whole


def decode(stored: NDArray[np.int16]) -> NDArray[np.float64]:
    """Positions [m] from what `encode` returned."""
    whole: NDArray[Any] = stored
    for axis in (2, 3):
        whole = np.cumsum(whole, axis=axis, dtype=np.int16)
    return QUANTUM * whole.astype(np.float64)
