"""The folder of a run: described when it is made, held by one process at a time, never overwritten in silence."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from flag_env._files import machine, read_json, write_json
from training import checkpoint
from training.hyperparameters import Hyperparameters
from training.lock import LOCK, held

RUN_ONLY = {"device", "hyperparameters", "n_envs", "output", "overwrite", "progress", "record", "resume", "total_timesteps"}
"""Arguments that a resumed run may change, or whose values are compared as hyperparameters."""


def finished(folder: Path, total_timesteps: int) -> bool:
    """Whether the folder holds the evaluation of a training that has done so many timesteps."""
    path = folder / "evaluation.json"
    return path.exists() and bool(read_json(path)["timesteps"] >= total_timesteps)


def check(folder: Path, arguments: Any, hyper: Hyperparameters) -> None:
    """Raise unless a run with these arguments may start or go on in the folder; nothing is changed.

    Parameters
    ----------
    folder
        Folder of the run.
    arguments
        The training's `Arguments`.
    hyper
        Its hyperparameters.

    Raises
    ------
    ValueError
        If the folder holds another run than is asked for, or one that is neither to be resumed nor overwritten.
    """
    if arguments.resume and arguments.overwrite:
        raise ValueError("--resume and --overwrite exclude each other")
    path = folder / "arguments.json"
    if arguments.resume and path.exists():
        _check_same(folder, read_json(path), arguments, hyper)
    elif not arguments.resume and _leftovers(folder):
        if not arguments.overwrite:
            raise ValueError(f"{folder} already holds a run; go on with --resume or replace it with --overwrite")
        if not path.exists():
            raise ValueError(f"{folder} holds no arguments.json, so it is no run of ours; remove it yourself")
    elif arguments.resume and [path for path in _leftovers(folder) if not path.match(".arguments-*.json")]:
        raise ValueError(f"{folder} holds no arguments.json, so it is no run of ours; remove it yourself")


@contextmanager
def claimed(folder: Path, arguments: Any, hyper: Hyperparameters) -> Iterator[None]:
    """Make the folder of a run, or take the one that is there, and hold it against other processes.

    `arguments.json` describes the run; of a run that is extended it tells the totals before.

    Raises
    ------
    ValueError
        As `check`, or if another process holds the folder.
    """
    check(folder, arguments, hyper)
    with held(folder):
        check(folder, arguments, hyper)  # again: another process may have been here before
        path = folder / "arguments.json"
        before = read_json(path) if arguments.resume and path.exists() else None
        if before is None:
            for old in _leftovers(folder):
                shutil.rmtree(old) if old.is_dir() else old.unlink()
        totals = [] if before is None else before.get("extended_from", [])
        if before is not None and hyper.total_timesteps > before["hyperparameters"]["total_timesteps"]:
            totals = [*totals, before["hyperparameters"]["total_timesteps"]]
        if before is None or totals != before.get("extended_from", []):
            given = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(arguments).items()}
            extended = {"extended_from": totals} if totals else {}
            write_json(path, {"arguments": given, "hyperparameters": asdict(hyper), **extended, "machine": machine()})
        yield


def _check_same(folder: Path, before: dict[str, Any], arguments: Any, hyper: Hyperparameters) -> None:
    """Raise unless the run that is described goes on, or a finished one is extended."""
    given, old = asdict(arguments), before["hyperparameters"]
    changed = [name for name, value in given.items() if name not in RUN_ONLY and value != before["arguments"].get(name)]
    changed += ["n_envs"] if hyper.n_envs != old["n_envs"] else []
    changed += ["hyperparameters"] if (hyper.policy, hyper.algorithm) != (old["policy"], old["algorithm"]) else []
    total, new = old["total_timesteps"], hyper.total_timesteps
    if changed or new < total:
        changed += ["total_timesteps"] if new < total else []
        raise ValueError(f"{folder} holds a run with other values of {', '.join(changed)}; resume it with the same")
    if new > total and not finished(folder, total):
        raise ValueError(f"total_timesteps must be {total}, with which {folder} was begun, until that run is finished, got {new}")
    if new > total and not checkpoint.paths(folder / "checkpoints"):
        raise ValueError(f"{folder} holds no checkpoint from which total_timesteps could be raised from {total} to {new}")


def _leftovers(folder: Path) -> list[Path]:
    """What a folder holds besides its lock."""
    return [path for path in folder.iterdir() if path.name != LOCK] if folder.exists() else []
