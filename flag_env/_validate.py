"""Checks of arguments: every error names the argument, the value and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

SMALLEST, LARGEST = 1e-100, 1e100
"""Magnitudes between which a number, if it is not zero, can be squared, divided by and multiplied without leaving float64."""

_FEW = 16
"""Entries up to which Python's own loop is quicker than NumPy's calls."""


def count(name: str, value: Any, minimum: int = 1, maximum: float = 2**63 - 1) -> int:
    """Return `value` as an int; raise unless it is a whole number from `minimum` to `maximum`: what the kernels can hold."""
    if isinstance(value, (bool, np.timedelta64)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if value < minimum:
        raise ValueError(f"{name} must be at least {minimum}, got {value!r}")
    if value > maximum:
        shown = repr(value) if int(value) < 10**18 else "a larger whole number"
        raise ValueError(f"{name} must be at most {maximum:g}, got {shown}")
    return int(value)


def counts(name: str, values: Any, minimum: int = 1, maximum: float = 2**63 - 1) -> list[int]:
    """Return `values` as a list of ints; raise unless they are a sequence of whole numbers from `minimum` to `maximum`."""
    try:
        entries = list(values)
    except TypeError:
        raise TypeError(f"{name} must be a sequence of whole numbers, got {values!r}") from None
    return [count(name, entry, minimum, maximum) for entry in entries]


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
    """Return `value` as a float; raise unless it is finite (or `infinite`), >= `minimum`, > `above` and <= `maximum`.

    If it is neither zero nor infinite, its magnitude must lie between `SMALLEST` and `LARGEST`.
    """
    try:
        if type(value) is not float and not _real(value):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number, got {value!r}") from None
    except OverflowError:
        raise ValueError(f"{name} must be of a magnitude up to {LARGEST:g}, got a whole number beyond") from None
    bad = math.isnan(result) if infinite else not math.isfinite(result)
    if bad or result < minimum or result <= above or result > maximum:
        bounds = [f"{sign} {bound:g}" for sign, bound in ((">=", minimum), (">", above), ("<=", maximum)) if math.isfinite(bound)]
        raise ValueError(f"{name} must be {' and '.join([*([] if infinite else ['finite']), *bounds])}, got {value!r}")
    if result != 0.0 and math.isfinite(result) and not SMALLEST <= abs(result) <= LARGEST:
        zero = "" if minimum > 0 or above >= 0 else "zero or "
        raise ValueError(f"{name} must be {zero}of a magnitude from {SMALLEST:g} to {LARGEST:g}, got {value!r}")
    return result


def _real(value: Any) -> bool:
    """Whether a value is one real number: neither a bool nor a string nor complex, an array only with no axes."""
    if isinstance(value, Real):
        return not isinstance(value, (bool, np.timedelta64))
    return np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"


def vector(name: str, value: Any, size: int = 3) -> tuple[float, ...]:
    """Return `value` as a tuple of `size` finite floats, each zero or of a magnitude from `SMALLEST` to `LARGEST`."""
    checked = array(name, value, (size,))
    return tuple(number(name, entry) for entry in (value if isinstance(value, (tuple, list)) else checked.tolist()))


def array(name: str, value: ArrayLike, *shapes: tuple[int, ...]) -> NDArray[np.float64]:
    """Return `value` as a float64 array; raise unless it is finite and has one of `shapes`."""
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iuf":  # complex, bool, text, dates, objects
            raise TypeError
        with np.errstate(over="ignore"):  # what float64 cannot hold is infinite, and named below
            result = np.asarray(given, dtype=np.float64)
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
