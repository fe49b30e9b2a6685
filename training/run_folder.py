"""The folder of a run: described when it is made, and never overwritten in silence."""

from __future__ import annotations

import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

from training.files import read_json, versions, write_json

RUN_ONLY = {"device", "hyperparameters", "output", "overwrite", "progress", "record", "resume"}
"""Arguments that a resumed run may change; the content of the hyperparameter file is compared instead of its path."""


def prepare(folder: Path, arguments: Any, hyperparameters: Any) -> None:
    """Make the folder of a run and describe it in `arguments.json`, or check the one that is there.

    Parameters
    ----------
    folder
        Folder of the run.
    arguments
        The training's `Arguments`.
    hyperparameters
        Its `Hyperparameters`.

    Raises
    ------
    ValueError
        If the folder holds another run than is asked for, or one that is neither to be resumed nor overwritten.
    """
    if arguments.resume and arguments.overwrite:
        raise ValueError("--resume and --overwrite exclude each other")
    given = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(arguments).items()}
    description = {"arguments": given, "hyperparameters": asdict(hyperparameters), "versions": versions()}
    path = folder / "arguments.json"
    if arguments.resume and path.exists():
        before = read_json(path)
        changed = [name for name, value in given.items() if name not in RUN_ONLY and value != before["arguments"].get(name)]
        changed += [] if description["hyperparameters"] == before["hyperparameters"] else ["hyperparameters"]
        if changed:
            raise ValueError(f"{folder} holds a run with other values of {', '.join(changed)}; resume it with the same")
        return
    if arguments.resume and folder.exists():
        for partial in folder.glob(f".{path.stem}-*{path.suffix}"):  # of a run killed while it described itself
            partial.unlink()
    if folder.exists() and any(folder.iterdir()):
        if not arguments.overwrite:
            raise ValueError(f"{folder} already holds a run; go on with --resume or replace it with --overwrite")
        if not path.exists():
            raise ValueError(f"{folder} holds no arguments.json, so it is no run of ours; remove it yourself")
        shutil.rmtree(folder)
    write_json(path, description)
