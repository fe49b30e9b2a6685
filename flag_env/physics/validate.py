"""Checks of arguments: every error names the argument, the value and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FEW = 16
"""Entries up to which Python's own loop is quicker than NumPy's calls."""


def count(name: str, value: Any, minimum: int = 1) -> int:
    """Return `value` as an int; raise unless it is a whole number of at least `minimum`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if value < minimum:
        raise ValueError(f"{name} must be at least {minimum}, got {value!r}")
    return int(value)


def boolean(name: str, value: Any) -> bool:
    """Return `value` as a bool; raise unless it is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def number(
    name: str,
    value: Any,
    *,
    minimum: float = -math.inf,
    above: float = -math.inf,
    maximum: float = math.inf,
    infinite: bool = False,
) -> float:
    """Return `value` as a float; raise unless it is finite (or `infinite`), >= `minimum`, > `above` and <= `maximum`."""
    try:
        if isinstance(value, (bool, str)) or np.ndim(value) != 0:
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} must be a number, got {value!r}") from None
    bad = math.isnan(result) if infinite else not math.isfinite(result)
    if bad or result < minimum or result <= above or result > maximum:
        bounds = [f"{sign} {bound:g}" for sign, bound in ((">=", minimum), (">", above), ("<=", maximum)) if math.isfinite(bound)]
        raise ValueError(f"{name} must be {' and '.join([*([] if infinite else ['finite']), *bounds])}, got {value!r}")
    return result


def vector(name: str, value: Any, size: int = 3) -> tuple[float, ...]:
    """Return `value` as a tuple of `size` finite floats."""
    result = array(name, value, (size,))
    return tuple(float(entry) for entry in result)


def array(name: str, value: ArrayLike, *shapes: tuple[int, ...]) -> NDArray[np.float64]:
    """Return `value` as a float64 array; raise unless it is finite and has one of `shapes`."""
    try:
        result = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be an array of numbers, got {value!r}") from None
    if result.shape not in shapes:
        allowed = " or ".join(str(shape) for shape in shapes)
        raise ValueError(f"{name} must have the shape {allowed}, got {result.shape}")
    few = result.size <= _FEW
    if not (all(map(math.isfinite, result.ravel().tolist())) if few else np.isfinite(result).all()):
        where = tuple(int(index) for index in np.argwhere(~np.isfinite(result))[0])
        raise ValueError(f"{name} must be finite, got {result[where]} at index {where}")
    return result


def choice(name: str, value: Any, allowed: Iterable[str]) -> str:
    """Return `value`; raise unless it is one of the `allowed` strings."""
    options = tuple(allowed)
    if not isinstance(value, str) or value not in options:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, options))}, got {value!r}")
    return str(value)
