"""Keeps the finished parts of a long study, so that a run that was stopped goes on where it was."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flag_env._files import machine, read_json, write_bytes
from flag_env.physics.compiling import source_digest


class Parts:
    """Results by name, in a file that is rewritten whole after each of them.

    Parameters
    ----------
    path
        The file. What it holds is dropped if it cannot be read, or comes from another machine, other versions or sources,
        or other settings.
    sources
        Files of the study; a change of them asks for new results.
    **settings
        Whatever else the results depend on.
    """

    def __init__(self, path: Path, sources: tuple[Path, ...], **settings: Any) -> None:
        self._path = path
        self._origin = {"machine": machine() | {"date": None}, "sources": source_digest(sources), **settings}
        self._found: dict[str, Any] = {}
        with contextlib.suppress(FileNotFoundError, ValueError):  # none, or damaged
            stored = read_json(path)
            if stored["origin"] == self._origin:
                self._found = stored["found"]

    def __len__(self) -> int:
        return len(self._found)

    def get(self, name: str, measure: Callable[[], Any]) -> Any:
        """The part's result, JSON-able; measured only if it is not there yet."""
        if name not in self._found:
            self._found[name] = measure()
            write_bytes(self._path, json.dumps({"origin": self._origin, "found": self._found}).encode())
        return self._found[name]

    def close(self) -> None:
        """Remove the file: the study is complete and stands in its own."""
        self._path.unlink(missing_ok=True)
