"""Snapshots of simple flags."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from render_flags import BOUNDS, MAST, lattice

from flag_env.render import Renderer, Snapshot


@pytest.fixture
def make() -> Callable[..., Snapshot]:
    """Return a maker of snapshots: keyword arguments replace the defaults."""

    def snapshot(**changes: Any) -> Snapshot:
        return Snapshot(**{"positions": lattice(), "mast": MAST, "bounds": BOUNDS} | changes)

    return snapshot


@pytest.fixture(scope="session")
def renderer() -> Renderer:
    """Return one renderer for all tests: what it drew before must not matter."""
    return Renderer(160, 120)
