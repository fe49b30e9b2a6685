"""What the compiled link forces of one, two and three coordinates share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.jit import jit, kernel


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
    tiny
        Added to the squared length [m^2].
    """

    offset: NDArray[np.int64]
    weight: NDArray[Any]
    stiffness: Any
    tension: NDArray[Any]
    tiny: Any


class Dampers(NamedTuple):
    """As `Springs`, with a viscosity [N s/m]."""

    offset: NDArray[np.int64]
    weight: NDArray[Any]
    stiffness: Any
    tension: NDArray[Any]
    tiny: Any
    viscosity: Any


@kernel
def _add(f, g, n):
    for t in range(n):
        f[t] += g[t]


@kernel
def _subtract(f, g, n):
    for t in range(n):
        f[t] -= g[t]


@jit
def scatter(f, scratch, offset, n):
    """Add the links' forces to their first particles, subtract them from their second."""
    for d in range(f.shape[0]):
        _add(f[d], scratch[d], n)
        _subtract(f[d, offset:], scratch[d], n)
