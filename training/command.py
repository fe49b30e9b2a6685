"""What the commands share: bad arguments are refused in words, before any work."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def refusals() -> Iterator[None]:
    """Around the checks of a command's arguments: end it with the error's words instead of a traceback."""
    try:
        yield
    except (TypeError, ValueError, FileNotFoundError) as error:
        raise SystemExit(f"error: {error}") from error
