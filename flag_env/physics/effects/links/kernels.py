"""What the compiled link forces of one, two and three coordinates share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.compiling import jit, kernel


class Springs(NamedTuple):
    """Arrays of springs.

    Attributes
    ----------
    offset : (families,)
        Second particle minus first.
    weight : (1 or copies, families, particles)
        Factor of each link, by its first particle; zero where there is none. One row of families serves all copies, unless links
        can break.
    stiffness
        [N/m].
    tension : (families,)
        Stiffness times rest length [N].
    length : (families,)
        Rest length [m]; zero on a rope, whose links have none.
    tiny
        Added to the squared length [m^2].
    """

    offset: NDArray[np.int64]
    weight: NDArray[Any]
    stiffness: Any
    tension: NDArray[Any]
    length: NDArray[Any]
    tiny: Any


class Dampers(NamedTuple):
    """As `Springs`, with a viscosity [N s/m]."""

    offset: NDArray[np.int64]
    weight: NDArray[Any]
    stiffness: Any
    tension: NDArray[Any]
    length: NDArray[Any]
    tiny: Any
    viscosity: Any


@kernel
def _clear(g, n):
    for t in range(n):
        g[t] = 0


@kernel
def _add(f, g, n):
    for t in range(n):
        f[t] += g[t]


@kernel
def _subtract(f, g, n):
    for t in range(n):
        f[t] -= g[t]


@kernel
def _gather(f, g, far_g, n):
    for t in range(n):
        f[t] = f[t] + g[t] - far_g[t]


@kernel
def _gather_two(f, g, far_g, h, far_h, n):
    for t in range(n):
        f[t] = f[t] + g[t] - far_g[t] + h[t] - far_h[t]


@jit
def near(offset, particles):
    """Whether a family's zeros are few beside its links."""
    return 5 * offset <= particles


@jit
def pad(g, coordinates, offset, particles):
    """Make rows of scratch ready for the forces of a family on its links' first particles, which are to begin at entry `offset`.

    With `offset` zeros before and behind, the same rows read from entry 0 are the forces from which the second particles suffer.
    """
    if near(offset, particles):
        for d in range(coordinates):
            _clear(g[d], offset)
            _clear(g[d, particles:], offset)


@jit
def add_family(f, g, offset):
    """Add the forces of a family to the links' first particles and subtract them from the second."""
    n = f.shape[1]
    for d in range(f.shape[0]):
        if near(offset, n):
            _gather(f[d], g[d, offset:], g[d], n)
        else:
            _add(f[d], g[d, offset:], n - offset)
            _subtract(f[d, offset:], g[d, offset:], n - offset)


@jit
def gather(f, effect_work, offset, j):
    """Add the forces of family `j`, two families at a time, the first in scratch's rows 0 to 2, the second in 3 to 5.

    One look at the sums serves both.
    """
    n, o = f.shape[1], offset[j]
    if j % 2 == 1:
        p = offset[j - 1]
        if near(o, n) and near(p, n):
            for d in range(f.shape[0]):
                _gather_two(f[d], effect_work[d, p:], effect_work[d], effect_work[d + 3, o:], effect_work[d + 3], n)
        else:
            add_family(f, effect_work, p)
            add_family(f, effect_work[3:], o)
    elif j + 1 == offset.shape[0]:
        add_family(f, effect_work, o)
