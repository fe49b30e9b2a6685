"""Builds the library of targets from a seed, and proves that every target of it can be reached.

A witness is drawn at random, replayed from the start under a hidden wind drawn at random, and kept if it holds the flag within
half the tolerance of its last pose for the last ten steps, and if other ways of acting (`Control.other_ways`) do so too: cloth
folds, and a fold that only one path leads to would be a matter of luck. Targets that idle actions reach ask for nothing: they may
serve to learn, but are left out of the other splits. The stored pose is rounded; the proof is made on what is stored.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.control import CONTROLS
from flag_env.envs.batch import EPISODE_STEPS, LEVELS, Settings, replay
from flag_env.tasks.targets import SIZES, SPLITS, Targets, decode, encode

HIDDEN_WIND = {"calm": np.zeros(3), "breeze": np.array([3.0, 4.0, 3.0])}
"""Largest hidden wind either way [m/s^2]."""

STEADY = 0.025
"""Largest distance to the last pose over the last ten steps, in flag diagonals."""

_CHUNK = 128


def build(control: str, level: str, seed: int, progress: Callable[[int], Any] = lambda done: None) -> dict[str, NDArray[Any]]:
    """Arrays of a library file; `progress` is told of every target found."""
    arrays: dict[str, NDArray[Any]] = {}
    for number, split in enumerate(SPLITS):
        rng = np.random.default_rng((seed, sorted(CONTROLS).index(control), LEVELS.index(level), number))
        settings = Settings(control=control, level=level, split=split)
        kept: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = []
        while len(kept) < SIZES[split]:
            drawn = _draw(control, level, rng)
            poses = replay(settings, drawn, range(_CHUNK))
            stored = decode(encode(poses[-1]))
            ways = [poses, *(replay(settings, other, range(_CHUNK)) for other in _other_ways(control, drawn))]
            reached = np.max([_distances(settings, way, stored).max(axis=0) for way in ways], axis=0) < STEADY
            if split != "train":
                idle = replay(settings, replace(drawn, witnesses=np.zeros_like(drawn.witnesses)), range(_CHUNK))
                reached &= _distances(settings, idle, stored).max(axis=0) > settings.tolerance
            found = np.flatnonzero(reached)[: SIZES[split] - len(kept)]
            kept += [(drawn.witnesses[i], drawn.wind[i], poses[-1, i]) for i in found]
            progress(len(found))
        witnesses, wind, last = (np.stack(column) for column in zip(*kept, strict=True))
        arrays |= {f"{split}_witnesses": witnesses, f"{split}_wind": wind, f"{split}_positions": encode(last)}
        arrays["spans"] = drawn.spans
    return arrays


def save(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Write a library file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    os.replace(partial, path)  # noqa: PTH105


def check(settings: Settings, library: Targets) -> Iterator[float]:
    """Replay every witness; for each target, the largest distance over the last ten steps, in flag diagonals."""
    for first in range(0, len(library), _CHUNK):
        indices = range(first, min(first + _CHUNK, len(library)))
        poses = replay(settings, library, indices)
        yield from _distances(settings, poses, library.positions[list(indices)]).max(axis=0)


def _draw(control: str, level: str, rng: np.random.Generator) -> Targets:
    """Candidates: witnesses with their hidden winds."""
    sequences = [CONTROLS[control].sample_witness(rng, EPISODE_STEPS).astype(np.float32) for _ in range(_CHUNK)]
    changed = np.flatnonzero(np.any(np.diff(np.stack(sequences), axis=1) != 0, axis=(0, 2))) + 1
    starts = np.array([0, *changed])
    wind = (HIDDEN_WIND[level] * rng.uniform(-1, 1, (_CHUNK, 3))).astype(np.float32)
    spans = np.diff([*starts, EPISODE_STEPS])
    return Targets(np.stack(sequences)[:, starts], spans, wind, np.zeros(0))


def _other_ways(control: str, drawn: Targets) -> list[Targets]:
    """The same candidates with each other way to act."""
    sequences = [CONTROLS[control].other_ways(drawn.actions(index)) for index in range(len(drawn))]
    spans = np.ones(EPISODE_STEPS, np.int64)
    return [replace(drawn, witnesses=np.stack(way), spans=spans) for way in zip(*sequences, strict=True)]


def _distances(settings: Settings, poses: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """RMS distances of poses (steps, targets, layers, rows, cols, 3) to `target`, in flag diagonals, (steps, targets)."""
    square = ((poses - target) ** 2).sum(axis=-1).mean(axis=(2, 3, 4))
    return np.sqrt(square) / settings.resolved_scene().lattice.diagonal  # type: ignore[no-any-return]
