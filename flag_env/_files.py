"""Files that are written whole or not at all, places that are checked before work begins, and a description of the machine."""

from __future__ import annotations

import datetime
import json
import os
import platform
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = ("flag_env", "numpy", "numba", "scipy", "gymnasium", "matplotlib", "stable_baselines3", "torch")
"""What results depend on; `machine` tells the versions of those that are installed."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`, which takes its place if the block ends without an error; folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(
        f".{path.stem}-{secrets.token_hex(4)}{path.suffix}"
    )  # the suffix stays: writers choose a format by it
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes, durable: bool = True) -> None:
    """Write bytes; if `durable`, they are on the disk before the file takes its name."""
    with replacing(path) as partial, partial.open("wb") as file:
        file.write(content)
        if durable:
            file.flush()
            os.fsync(file.fileno())


def write_json(path: Path, content: Any) -> None:
    """Write JSON; NaN and infinity are refused."""
    write_bytes(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def read_json(path: Path) -> Any:
    """Content of a JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))


def check_folder(name: str, path: Path) -> Path:
    """Return `path`; raise a ValueError unless files can be written into that folder, or it can be made. Nothing is made."""
    there = path
    while not there.exists() and not there.is_symlink() and there != there.parent:
        there = there.parent
    if not there.is_dir():
        what = "is a file" if there == path else f"lies below {there}, which is no folder"
        raise ValueError(f"{name} must be a folder that can be written to, got {path}, which {what}")
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise ValueError(f"{name} must be a folder that can be written to, got {path} ({error.strerror or error})") from error
    return path


def check_file(name: str, path: Path, suffixes: tuple[str, ...] = ()) -> Path:
    """Return `path`; raise a ValueError unless it can be written as a file with one of `suffixes` (none: any)."""
    if suffixes and path.suffix.lower() not in suffixes:
        raise ValueError(f"{name} must be a name that ends in {' or '.join(suffixes)}, got {path}")
    if path.is_dir():
        raise ValueError(f"{name} must be a file, got {path}, which is a folder")
    check_folder(f"the folder of {name}", path.parent)
    return path


def machine() -> dict[str, Any]:
    """Processor, number of usable cores, system, versions and date."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": _processor(),
        "cores": cores,
        "system": f"{platform.system()} {platform.machine()}",
        "versions": versions,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown"
