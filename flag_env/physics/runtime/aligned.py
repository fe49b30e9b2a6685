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
_SLOT = 512
"""Distance within a page from the beginning of one array to that of the next [bytes]."""

_ROW_SHIFT = 320
"""Distance of rows, in multiples of which they begin [bytes]."""


def zeros(slot: int, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros, contiguous, that begin `slot` slots after the beginning of a page."""
    kind = np.dtype(dtype)
    size = int(np.prod(shape)) * kind.itemsize
    memory = np.zeros(size + _PAGE, np.uint8)
    first = (slot * _SLOT - memory.ctypes.data) % _PAGE
    return memory[first : first + size].view(kind).reshape(shape)


def padded_row(length: int, dtype: DTypeLike) -> int:
    """A length of rows, no less than this, with which the rows of an array begin at places of their own."""
    size = np.dtype(dtype).itemsize
    return length if length * size < _PAGE else -(-(length * size - _ROW_SHIFT) // _PAGE) * _PAGE // size + _ROW_SHIFT // size
