"""The library of target poses, each with its witness: the actions that reach it.

A target is the pose in which the flag ends when its witness is replayed from the start under the target's hidden wind. Poses are
shipped for the default scene, rounded to 1/4096 m; `envs.certify` builds them from a seed, and keeps only targets whose witness
holds the flag within half the tolerance for the last ten steps. Splits never share a witness.
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

SPLITS = ("train", "validation", "test")
SIZES = {"train": 768, "validation": 128, "test": 128}
"""Number of targets of each split."""

PARTS = ("witnesses", "wind", "positions")
"""Arrays that a library file has of each split; besides, `spans`, `seed` and a digest of each split."""

QUANTUM = 2.0**-12
"""Resolution of the stored positions [m]."""

LARGEST = 2**15 - 1
"""Largest coordinate that can be stored, in quanta."""


@dataclass(frozen=True)
class Targets:
    """Targets of one control, level and split.

    Attributes
    ----------
    witnesses : (targets, knots, action) float32
        Actions; each knot is held for its share of the episode, as `spans` tells.
    spans : (knots,)
        Number of steps of each knot.
    wind : (targets, 3) float32
        Hidden wind [m/s^2], on top of the known one.
    positions : (targets, layers, rows, cols, 3)
        Poses [m].
    """

    witnesses: NDArray[np.float32]
    spans: NDArray[np.int64]
    wind: NDArray[np.float32]
    positions: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.witnesses)

    def actions(self, index: int) -> NDArray[np.float32]:
        """The witness of one target, an action a step, shape (steps, action)."""
        return np.repeat(self.witnesses[index], self.spans, axis=0)


@lru_cache(maxsize=16)
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
