"""Calibrations kept on disk, so that a scene is calibrated once and not once a process.

One small file each, beside the compiled code (`flag_env.physics.compiling`), under a digest of everything that the answer depends
on: the scene and what was asked of it, the sources of `flag_env.physics`, the versions of Python, Numba, NumPy and SciPy, and the
processor's kind. A scene with an effect from outside the package, whose sources are not known, is not kept. A file that is
damaged counts as none.
"""

from __future__ import annotations

import hashlib
import json
import platform
from pathlib import Path
from typing import Any

import numpy
import scipy

from flag_env.physics.compiling import cache_root, keep_on_disk, load_from_disk, source_digest
from flag_env.physics.scene import Scene

_PACKAGE = "flag_env.physics."


def file_of(scene: Scene, *asked: float) -> Path | None:
    """Where the answer for this scene and these numbers is kept; None where it is not."""
    root = cache_root()
    if root is None or not all(type(part).__module__.startswith(_PACKAGE) for part in (*scene.effects, scene.integrator)):
        return None
    versions = f"{numpy.__version__} {scipy.__version__} {platform.machine()}"
    key = hashlib.sha256(f"{source_digest()} {versions} {asked!r} {scene!r}".encode()).hexdigest()
    return root / "calibrations" / f"{key}.calibration"


def load(file: Path | None) -> dict[str, Any] | None:
    """What the file holds; None where there is none that can be read."""
    content = None if file is None else load_from_disk(file)
    try:
        found = None if content is None else json.loads(content)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def keep(file: Path | None, answer: dict[str, Any]) -> None:
    """Write the file; nothing is kept where that fails."""
    if file is not None:
        keep_on_disk(file, json.dumps(answer).encode())
