"""Calibrations kept on disk, so that a scene is calibrated once and not once a process.

One small JSON file each, in a folder beside the compiled code (`flag_env.physics.jit`), under a digest of everything that the
answer depends on: the scene and what was asked of it, the sources of `flag_env.physics`, the versions of Python, Numba, NumPy and
SciPy, and the processor's kind. A scene with an effect from outside the package, whose sources are not known, is not kept. A file
is written whole or not at all, and one that cannot be read counts as none.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import tempfile
from pathlib import Path
from typing import Any

import numpy
import scipy

from flag_env.physics.jit import cache_root, source_digest
from flag_env.physics.scene import Scene

_PACKAGE = "flag_env.physics."


def file_of(scene: Scene, *asked: float) -> Path | None:
    """Where the answer for this scene and these numbers is kept; None where it is not."""
    root = cache_root()
    if root is None or not all(type(part).__module__.startswith(_PACKAGE) for part in (*scene.effects, scene.integrator)):
        return None
    versions = f"{numpy.__version__} {scipy.__version__} {platform.machine()}"
    key = hashlib.sha256(f"{source_digest()} {versions} {asked!r} {scene!r}".encode()).hexdigest()
    return root / "calibrations" / f"{key}.json"


def load(file: Path | None) -> dict[str, Any] | None:
    """What the file holds; None where there is none that can be read."""
    if file is None:
        return None
    try:
        found = json.loads(file.read_text())
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def keep(file: Path | None, answer: dict[str, Any]) -> None:
    """Write the file; nothing is kept where that fails."""
    if file is None:
        return
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, partial = tempfile.mkstemp(dir=file.parent)
        with os.fdopen(handle, "w") as stream:
            json.dump(answer, stream)
        Path(partial).replace(file)
