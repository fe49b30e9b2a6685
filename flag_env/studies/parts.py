"""Keeps the finished parts of a long study, so that a run that was stopped goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flag_env.physics.jit import source_digest
from flag_env.studies import report


class Parts:
    """Results by name, in a file that is rewritten whole after each of them.

    Parameters
    ----------
    path
        The file. What it holds is dropped if it comes from another machine, other versions or sources, or other settings.
    sources
        Files of the study; a change of them asks for new results.
    **settings
        Whatever else the results depend on.
    """

    def __init__(self, path: Path, sources: tuple[Path, ...], **settings: Any) -> None:
        machine = report.machine() | {"date": None}
        self._path = path
        self._origin = {"machine": machine, "sources": source_digest(sources), **settings}
        self._found: dict[str, Any] = {}
        if path.exists():
            stored = json.loads(path.read_text())
            if stored["origin"] == self._origin:
                self._found = stored["found"]

    def __len__(self) -> int:
        return len(self._found)

    def get(self, name: str, measure: Callable[[], Any]) -> Any:
        """The part's result, JSON-able; measured only if it is not there yet."""
        if name not in self._found:
            self._found[name] = measure()
            self._path.parent.mkdir(parents=True, exist_ok=True)
            text = json.dumps({"origin": self._origin, "found": self._found})
            report.replace_file(self._path, lambda path: path.write_text(text))
        return self._found[name]

    def close(self) -> None:
        """Remove the file: the study is complete and stands in its own."""
        self._path.unlink(missing_ok=True)
