"""Builds the library of targets from a seed, and proves that every target of it can be reached.

A witness is drawn at random, replayed from the start under a hidden wind drawn at random, and kept if it holds the flag within
half the tolerance of its last pose for the last ten steps, and if `Control.alternative_actions` do so too: cloth folds, and a
fold that only one path leads to would be a matter of luck. Targets that idle actions reach ask for nothing: they may serve to
learn, but are left out of the other splits. The stored pose is rounded; the proof is made on what is stored.
"""

from __future__ import annotations

import io
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env._files import write_bytes
from flag_env.control import CONTROLS, Control
from flag_env.envs.batch import replay
from flag_env.envs.config import EPISODE_STEPS, FlagConfig
from flag_env.envs.observation import observed_nodes
from flag_env.envs.prove import NONE, Library, proven
from flag_env.tasks import LEVELS, PARTS, QUANTUM, SPLITS, Level, Targets, decode, digest, encode

MAX_DRIFT = 0.025
"""Largest distance to the last pose over the last ten steps, in flag diagonals."""

_CHUNK = 128


_NUMBERS = {"mast": 0, "wind": 1, "both": 2, "wind+frequency": 3}
"""Part of the seed of each control that has targets."""


def build(control: str, level: str, seed: int, progress: Callable[[int], Any] = lambda done: None) -> dict[str, NDArray[Any]]:
    """Arrays of a library file; `progress` is told of every target found."""
    arrays: dict[str, NDArray[Any]] = {}
    task, others = LEVELS[level], Library([])
    for number, (split, count) in enumerate(task.splits):
        rng = np.random.default_rng((seed, _NUMBERS[control], list(LEVELS).index(level), number))
        if task.witness is None:
            found = certified(CONTROLS[control], task, count, rng, split == "train", progress)
        else:
            found = proven(FlagConfig(control, task, targets=NONE), count, rng, others, split == "shift", progress)
        arrays |= {f"{split}_witnesses": found.witnesses, f"{split}_wind": found.wind, "spans": found.spans}
        arrays[f"{split}_positions"] = (
            encode(found.positions) if found.ends is None else np.rint(found.ends / QUANTUM).astype(np.int16)
        )
    return arrays


def certified(
    control: type[Control],
    level: Level,
    count: int,
    rng: np.random.Generator,
    idle: bool = False,
    progress: Callable[[int], Any] = lambda done: None,
) -> Targets:
    """So many targets of a control and level, of the package or your own, each proven to be reached by its witness.

    Parameters
    ----------
    control, level
        What acts, and what is hidden.
    count
        How many targets.
    rng
        Draws witnesses and hidden winds.
    idle
        Whether targets may be such that a flag left alone reaches them.
    progress
        Called with the number of targets that each batch of candidates has brought.
    """
    kept: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = []
    while len(kept) < count:
        drawn = _draw(control, level, rng)
        config = FlagConfig(control, level, targets=drawn)
        poses = replay(config, drawn, range(_CHUNK))
        stored = decode(encode(poses[-1]))
        ways = [poses, *(replay(config, other, range(_CHUNK)) for other in _alternative_actions(control, drawn))]
        reached = np.max([_distances(config, way, stored).max(axis=0) for way in ways], axis=0) < MAX_DRIFT
        if not idle:
            still = replay(config, replace(drawn, witnesses=np.zeros_like(drawn.witnesses)), range(_CHUNK))
            reached &= _distances(config, still, stored).max(axis=0) > config.tolerance
        found = np.flatnonzero(reached)[: count - len(kept)]
        kept += [(drawn.witnesses[i], drawn.wind[i], poses[-1, i]) for i in found]
        progress(len(found))
    witnesses, wind, last = (np.stack(column) for column in zip(*kept, strict=True))
    return Targets(witnesses, drawn.spans, wind, decode(encode(last)))


def save(path: Path, arrays: dict[str, NDArray[Any]], seed: int) -> None:
    """Write a library file whole or not at all; it tells its seed, and digests that `read_targets` checks."""
    noted: dict[str, NDArray[Any]] = {"seed": np.array(seed)}
    for split in [split for split in SPLITS if f"{split}_wind" in arrays]:
        parts = (*(arrays[f"{split}_{name}"] for name in PARTS), arrays["spans"])
        noted[f"{split}_digest"] = np.array(digest(seed, split, *parts))
    content = io.BytesIO()  # an interrupt amid a zip file on disk would be told as a closed file
    np.savez_compressed(content, allow_pickle=False, **arrays, **noted)
    write_bytes(path, content.getvalue())


@contextmanager
def swapped(folder: Path) -> Iterator[Path]:
    """Give an empty folder; what is written there takes its place in `folder` once the block has ended without an error.

    Otherwise `folder` stays as it was. Files are renamed one by one, within a millisecond and deaf to Ctrl-C; a machine that
    fails just then may leave old ones beside new ones, each whole, which their seeds tell.

    Raises
    ------
    FileExistsError
        If another process is at it, or was killed.
    """
    new, staging = not folder.exists(), folder / ".building"
    folder.mkdir(parents=True, exist_ok=True)
    staging.mkdir()
    try:
        yield staging
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            for path in sorted(staging.iterdir()):
                path.replace(folder / path.name)
        finally:
            signal.signal(signal.SIGINT, before)
    finally:
        shutil.rmtree(staging)
        if new and not any(folder.iterdir()):
            folder.rmdir()


def check(config: FlagConfig, library: Targets) -> Iterator[float]:
    """Replay every witness; for each target, the largest distance over the last ten steps, in flag diagonals.

    Of libraries without poses, the distance of the observed nodes after the last step; what is stored is rounded to 1/4096 m.
    """
    for first in range(0, len(library), _CHUNK):
        indices = range(first, min(first + _CHUNK, len(library)))
        judged = config.task.goal.steps
        if library.ends is not None:
            last = replay(config, library, indices, 1)[-1].reshape(len(indices), -1, 3)
            away = last[:, observed_nodes(config.resolved_scene())] - library.ends[list(indices)]
            yield from np.sqrt((away**2).sum(axis=2).mean(axis=1)) / config.resolved_scene().lattice.diagonal
            continue
        poses, wanted = replay(config, library, indices, judged), library.positions[list(indices)]
        yield from _distances(config, poses, wanted).max(axis=0)


def _draw(control: type[Control], level: Level, rng: np.random.Generator) -> Targets:
    """Candidates: witnesses with their hidden winds."""
    sequences = [control.sample_witness(rng, EPISODE_STEPS).astype(np.float32) for _ in range(_CHUNK)]
    changed = np.flatnonzero(np.any(np.diff(np.stack(sequences), axis=1) != 0, axis=(0, 2))) + 1
    starts = np.array([0, *changed])
    wind = (np.array(level.hidden_wind) * rng.uniform(-1, 1, (_CHUNK, 3))).astype(np.float32)
    spans = np.diff([*starts, EPISODE_STEPS])
    return Targets(np.stack(sequences)[:, starts], spans, wind, np.zeros(0))


def _alternative_actions(control: type[Control], drawn: Targets) -> list[Targets]:
    """The same candidates with each other way to act."""
    sequences = [control.alternative_actions(drawn.actions(index)) for index in range(len(drawn))]
    spans = np.ones(EPISODE_STEPS, np.int64)
    return [replace(drawn, witnesses=np.stack(way), spans=spans) for way in zip(*sequences, strict=True)]


def _distances(config: FlagConfig, poses: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """RMS distances of poses (steps, targets, layers, rows, cols, 3) to `target`, in flag diagonals, (steps, targets)."""
    square = ((poses - target) ** 2).sum(axis=-1).mean(axis=(2, 3, 4))
    return np.sqrt(square) / config.resolved_scene().lattice.diagonal  # type: ignore[no-any-return]
