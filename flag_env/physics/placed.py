"""Arrays placed so that a loop over many of them does not evict its own data.

Rows whose length is a multiple of 4096 bytes, as in lattices of powers of two, all begin at one place of their pages, and large
arrays do so anyway. The first cache keeps only some eight lines for one such place, and a load waits for a store to the same
place of another page: so placed, a particle of 160 x 256 cost half as much again as one of 160 x 257.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_PAGE = 4096
_STEP = 512
"""Distance within a page from the beginning of one array to that of the next [bytes]."""

_PITCH = 320
"""The same for rows [bytes]."""


def zeros(place: int, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros, contiguous, that begin `place` steps after the beginning of a page."""
    kind = np.dtype(dtype)
    size = int(np.prod(shape)) * kind.itemsize
    room = np.zeros(size + _PAGE, np.uint8)
    first = (place * _STEP - room.ctypes.data) % _PAGE
    return room[first : first + size].view(kind).reshape(shape)


def pitch(length: int, dtype: DTypeLike) -> int:
    """A length of rows, no less than this, with which the rows of an array begin at places of their own."""
    size = np.dtype(dtype).itemsize
    return length if length * size < _PAGE else -(-(length * size - _PITCH) // _PAGE) * _PAGE // size + _PITCH // size
