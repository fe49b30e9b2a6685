"""Which sources compiled code comes from: its folder is named after their digest, so edited code is never served stale.

Numba by itself renews a cached function only when the function's own file changes, although the machine code contains every
kernel that it calls. What happens where the disk fails is `disk_cache`'s matter.
"""

from __future__ import annotations

import hashlib
import sys
from functools import lru_cache
from pathlib import Path

import llvmlite
import numba

PHYSICS = Path(__file__).parents[1]
"""The folder whose sources take part in everything compiled."""


@lru_cache
def source_digest(extra: tuple[Path, ...] = ()) -> str:
    """Hexadecimal digest of the package's physics sources, of `extra` files and of the compiler's version."""
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__} {sys.version}".encode())
    for path in (*sorted(PHYSICS.rglob("*.py")), *extra):
        digest.update(str(path.name).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:20]
