"""What an action of many flags must be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_SINGLE = np.dtype(np.float32)


def check_action(action: Any, shape: tuple[int, ...]) -> None:
    """Raise the ValueError of `FlagBatch.step`, if any."""
    if not np.isfinite(shaped(action, shape)).all():
        raise not_finite(action)


def shaped(action: Any, shape: tuple[int, ...]) -> NDArray[np.floating[Any]]:
    """The action as an array; float32 stays as it is."""
    given = action if type(action) is np.ndarray and action.dtype is _SINGLE else np.asarray(action, np.float64)
    if given.shape != shape:
        raise ValueError(f"action must have the shape {shape}, got {given.shape}")
    return given


def not_finite(action: Any) -> ValueError:
    """The error that tells of an action that is not finite."""
    return ValueError(f"action must be finite, got {action!r}")
