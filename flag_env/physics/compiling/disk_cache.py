"""What is kept on disk between processes, compiled code and calibrations: a help that may fail, and never the run with it.

Each thing is a file of its own, which begins with a digest of the rest: one that was cut short, damaged or written by another
version counts as none, and the next `keep_on_disk` mends it. Files take their names when they are whole, so that processes that
write at the same time do not meet. Where nothing can be written (no home, no right, no room, a file in a folder's place)
nothing is kept. Whatever fails is told by one warning a process.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path

from flag_env._files import write_bytes

_DIGEST = hashlib.sha256().digest_size

_told: set[str] = set()


@lru_cache(maxsize=1)
def cache_root() -> Path | None:
    """First writable place: `NUMBA_CACHE_DIR`, the user's cache folder, the temporary folder; None where there is none."""
    for place in _places():
        root = place / "flag_env"
        with contextlib.suppress(OSError):
            root.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=root) as probe:
                probe.write(b"0")
            return root
    warn("no folder is writable for compiled code")
    return None


def _places() -> list[Path]:
    places = [Path(os.environ[name]) for name in ("NUMBA_CACHE_DIR", "LOCALAPPDATA", "XDG_CACHE_HOME") if os.environ.get(name)]
    if not os.environ.get("XDG_CACHE_HOME"):
        with contextlib.suppress(RuntimeError):  # a user without HOME whom the system does not know
            places.append(Path("~/.cache").expanduser())
    with contextlib.suppress(OSError):  # no temporary folder
        places += _temporary()
    return places


def _temporary() -> list[Path]:
    """A folder of this user alone among everyone's temporary files; none if another made it: what lies there is run as code."""
    if not hasattr(os, "getuid"):
        return [Path(tempfile.gettempdir()) / "cache-user"]
    place = Path(tempfile.gettempdir()) / f"cache-{os.getuid()}"
    place.mkdir(mode=0o700, exist_ok=True)
    found = place.lstat()
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return [place] if ours else []


def load_from_disk(path: Path) -> bytes | None:
    """What was kept at `path`; None where there is nothing, or nothing whole."""
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        warn(f"{path} cannot be read ({error})")
        return None
    if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
        warn(f"{path} is damaged, and made anew")
        return None
    return content[_DIGEST:]


def keep_on_disk(path: Path, content: bytes) -> None:
    """Keep `content` at `path`; nothing is kept where that fails."""
    try:
        write_bytes(path, hashlib.sha256(content).digest() + content, durable=False)
    except OSError as error:
        warn(f"{path.parent} takes no files ({error}), so that what is compiled or calibrated now is not kept")


def warn(what: str) -> None:
    """Tell once a process that the cache is of no help."""
    if not _told:
        _told.add(what)
        advice = "the run goes on, and the next ones start slowly; NUMBA_CACHE_DIR may name another folder"
        warnings.warn(f"cache: {what}; {advice}", RuntimeWarning, stacklevel=2)
