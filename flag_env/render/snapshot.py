"""The immutable picture of one flag that a renderer draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Snapshot"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """All that one frame shows, in SI units; x along the flag, y normal to it at rest, z up.

    Arrays are copied and made read-only, so a snapshot never changes after it is made.

    Attributes
    ----------
        positions: particle positions [m], shape (layers, rows, cols, 3); row 0 lowest, column 0 at the mast.
        mast: lowest and highest point of the hoist [m], shape (2, 3); the pole is drawn down to the ground.
        bounds: lowest and highest corner of the view box [m], shape (2, 3); its floor is the ground.
            Two snapshots with equal bounds are seen by the same camera.
        target: target positions [m], the shape of `positions`, drawn as a ghost; None draws no ghost.
        wind: wind vector, shape (3,), in the unit of `wind_scale`; None draws no arrow.
        wind_scale: magnitude of the wind that draws as an arrow of full length; positive.
        success: whether the flag is within tolerance of the target; turns the ghost green.
        distance: distance to the target as a fraction of the flag's diagonal; None draws no gauge.
        tolerance: distance at which the gauge carries its mark; None draws no mark.
        intact: which cells of the lattice are cloth, shape (layers, rows - 1, cols - 1); the others are torn and not
            drawn; None: all are cloth.
    """

    positions: Array
    mast: Array
    bounds: Array
    target: Array | None = None
    wind: Array | None = None
    wind_scale: float = 1.0
    success: bool = False
    distance: float | None = None
    tolerance: float | None = None
    intact: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Copy, check and freeze every field."""
        positions = _frozen("positions", self.positions)
        if positions.ndim != 4 or positions.shape[-1] != 3 or positions.size == 0:
            raise ValueError(f"positions has shape {positions.shape}; allowed is (layers, rows, cols, 3), none of them 0")
        bounds = _frozen("bounds", self.bounds, (2, 3))
        if not np.all(bounds[0] < bounds[1]):
            raise ValueError(f"bounds is {bounds.tolist()}; allowed is (lowest, highest), lowest < highest on each axis")
        _set(self, "positions", positions)
        _set(self, "bounds", bounds)
        _set(self, "mast", _frozen("mast", self.mast, (2, 3)))
        if self.intact is not None:
            _set(self, "intact", _mask("intact", self.intact, (positions.shape[0], *(n - 1 for n in positions.shape[1:3]))))
        if self.target is not None:
            _set(self, "target", _frozen("target", self.target, positions.shape))
        if self.wind is not None:
            _set(self, "wind", _frozen("wind", self.wind, (3,)))
        _set(self, "success", bool(self.success))
        _set(self, "wind_scale", _number("wind_scale", self.wind_scale, positive=True))
        if self.distance is not None:
            _set(self, "distance", _number("distance", self.distance))
        if self.tolerance is not None:
            _set(self, "tolerance", _number("tolerance", self.tolerance, positive=True))


def _set(snapshot: Snapshot, name: str, value: object) -> None:
    object.__setattr__(snapshot, name, value)


def _frozen(name: str, value: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Return a read-only float64 copy of `value`; raise ValueError unless it is finite and of `shape`."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is {value!r}; allowed is an array of real numbers") from error
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; allowed is {shape}")
    finite = np.isfinite(array)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(f"{name} is {array[where]} at index {where}; allowed are finite numbers")
    array.setflags(write=False)
    return array


def _mask(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a read-only copy of `value`; raise ValueError unless it is of booleans and of `shape`."""
    array = np.array(value)
    if array.dtype != np.bool_:
        raise ValueError(f"{name} has dtype {array.dtype}; allowed is bool")
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; allowed is {shape}")
    array.setflags(write=False)
    return array


def _number(name: str, value: float, *, positive: bool = False) -> float:
    """Return `value` as a float; raise ValueError unless it is finite and >= 0 (> 0 if `positive`)."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is {value!r}; allowed is a number") from error
    if not np.isfinite(number) or number < 0.0 or (positive and number == 0.0):
        raise ValueError(f"{name} is {value!r}; allowed is a finite number {'> 0' if positive else '>= 0'}")
    return number
