"""The library of target poses, each with its witness: the actions that reach it.

A target is the pose in which the flag ends when its witness is replayed from the start under the target's hidden wind. Poses are
shipped for the default scene, rounded to 1/4096 m; `envs.certify` builds them from a seed, and keeps only targets whose witness
holds the flag within half the tolerance for the last ten steps. Splits never share a witness.
"""

from __future__ import annotations

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
    """One split of a library file."""
    with np.load(path) as data:
        witnesses, wind = data[f"{split}_witnesses"], data[f"{split}_wind"]
        return Targets(witnesses, data["spans"], wind, decode(data[f"{split}_positions"]))


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
