"""The lattice of particles and its families of links.

Particles stand on a grid `layers x rows x cols`. Column 0 is the mast, row 0 the lowest row, layer 0 the front. A particle's flat
number is `(layer * rows + row) * cols + col`, so that all links of one kind (a *family*) join particle `t` to particle
`t + offset` with one constant offset: one contiguous loop per family, a weight of zero where the pair would wrap round the end
of a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate

PINNED = ("edge", "sleeve", "ends", "none")

Direction = tuple[int, int, int]
"""A link's direction: (layers, rows, columns) from its first to its second particle."""

SIDES: tuple[Direction, ...] = ((0, 0, 1), (0, 1, 0))
"""Directions of the sides of a cell: along a row, up a column. Structural links have them."""


@dataclass(frozen=True)
class Family:
    """All links of a lattice in one direction.

    Attributes
    ----------
    offset
        Flat number of a link's second particle minus that of its first.
    present : (particles - offset,) bool
        Whether a link starts at the particle.
    length
        Rest length [m].
    taper : (particles - offset,)
        Mean of the two ends' share of the mast-side mass.
    """

    offset: int
    present: NDArray[np.bool_]
    length: float
    taper: NDArray[np.float64]

    def weight(self, tapered: bool) -> NDArray[np.float64]:
        """Factor on stiffness and viscosity of each link, shape (particles - offset,); zero where there is no link."""
        return np.where(self.present, self.taper if tapered else 1.0, 0.0)


@dataclass(frozen=True)
class Lattice:
    """A grid of particles, some of them pinned.

    Parameters
    ----------
    layers, rows, cols
        Number of particles across, up and along.
    spacing
        Distance of neighbours [m]: one number, (along, up) or (along, up, across). By default layers stand `along` apart.
    mass
        Mass of a particle at the mast [kg].
    taper
        Mass of a particle at the free edge / mass at the mast; linear in the column between them.
    pinned
        "edge": column 0; "sleeve": columns 0 and 1, which clamps the direction of the cloth as well; "ends": first and last
        column; "none"; or a tuple of flat particle numbers.
    dimensions
        Coordinates that a particle moves in: 3; 2, x and z (a sheet in its plane); or 1, z (the report's rope, whose particles
        are displaced across it). No other coordinate is stored or computed.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, its value and what is allowed.
    """

    layers: int = 1
    rows: int = 20
    cols: int = 32
    spacing: float | tuple[float, ...] = 0.05
    mass: float = 1e-3
    taper: float = 1.0
    pinned: str | tuple[int, ...] = "edge"
    dimensions: int = 3

    def __post_init__(self) -> None:
        for name in ("layers", "rows", "cols"):
            object.__setattr__(self, name, _validate.count(name, getattr(self, name)))
        object.__setattr__(self, "spacing", _spacing(self.spacing))
        object.__setattr__(self, "mass", _validate.number("mass", self.mass, above=0.0))
        object.__setattr__(self, "taper", _validate.number("taper", self.taper, above=0.0))
        if _validate.count("dimensions", self.dimensions) > 3:
            raise ValueError(f"dimensions must be 1, 2 or 3, got {self.dimensions!r}")
        if self.dimensions < 3 and self.layers > 1:
            raise ValueError(f"layers must be 1 with dimensions={self.dimensions}, got {self.layers!r}")
        if isinstance(self.pinned, str):
            _validate.choice("pinned", self.pinned, PINNED)
        else:
            object.__setattr__(self, "pinned", _particle_numbers(self.pinned, self.size))

    @property
    def shape(self) -> tuple[int, int, int]:
        """(layers, rows, cols)."""
        return self.layers, self.rows, self.cols

    @property
    def axes(self) -> tuple[int, ...]:
        """Axes of the coordinates that particles move in: 0 = x, 1 = y, 2 = z."""
        return {1: (2,), 2: (0, 2), 3: (0, 1, 2)}[self.dimensions]

    @property
    def size(self) -> int:
        """Number of particles."""
        return self.layers * self.rows * self.cols

    @property
    def spacings(self) -> tuple[float, float, float]:
        """Distance of neighbours along, up and across [m]."""
        if not isinstance(self.spacing, tuple):
            return self.spacing, self.spacing, self.spacing
        along, up, *across = self.spacing
        return along, up, across[0] if across else along

    @property
    def extent(self) -> tuple[float, float]:
        """Length along x and height along z at rest [m]."""
        along, up, _ = self.spacings
        return along * (self.cols - 1), up * (self.rows - 1)

    @property
    def diagonal(self) -> float:
        """Diagonal of the cloth at rest [m]; the spacing where there is but one particle."""
        return float(np.hypot(*self.extent)) or self.spacings[0]

    @cached_property
    def rest_positions(self) -> NDArray[np.float64]:
        """Positions at rest [m], shape (layers, rows, cols, 3): particle (0, 0, 0) at the origin, z up, y across."""
        along, up, across = self.spacings
        layer, row, col = np.indices(self.shape)
        return _read_only(np.stack([col * along, layer * across, row * up], axis=-1).astype(np.float64))

    @cached_property
    def taper_profile(self) -> NDArray[np.float64]:
        """Share of the mast-side mass, flat, shape (particles,)."""
        fraction = np.indices(self.shape)[2].ravel() / max(self.cols - 1, 1)
        return _read_only(1.0 - (1.0 - self.taper) * fraction)

    @property
    def masses(self) -> NDArray[np.float64]:
        """Masses [kg], flat, shape (particles,)."""
        return self.mass * self.taper_profile

    @cached_property
    def fixed(self) -> NDArray[np.bool_]:
        """Whether a particle is pinned, flat, shape (particles,)."""
        fixed = np.zeros(self.shape, dtype=bool)
        if not isinstance(self.pinned, str):
            fixed.ravel()[list(self.pinned)] = True
        elif self.pinned in ("edge", "ends", "sleeve"):
            fixed[:, :, 0] = True
            if self.pinned == "ends":
                fixed[:, :, -1] = True
            if self.pinned == "sleeve":
                fixed[:, :, :2] = True
        return _read_only(fixed.ravel())

    def families(self, *directions: Direction) -> tuple[Family, ...]:
        """Link families in the given directions; directions in which the lattice holds no link are left out."""
        families = (self._family(direction) for direction in directions)
        return tuple(family for family in families if family.present.any())

    def _family(self, direction: Direction) -> Family:
        offset = (direction[0] * self.rows + direction[1]) * self.cols + direction[2]
        if offset <= 0:  # only on lattices too small to hold such a link
            return Family(0, np.zeros(self.size, dtype=bool), 0.0, np.zeros(self.size))
        starts = tuple(slice(max(-by, 0), max(end - max(by, 0), 0)) for by, end in zip(direction, self.shape, strict=True))
        whole = np.zeros(self.shape, dtype=bool)
        whole[starts] = True
        present = whole.ravel()[: max(self.size - offset, 0)]
        along, up, across = self.spacings
        length = float(np.linalg.norm([direction[2] * along, direction[0] * across, direction[1] * up]))
        profile = self.taper_profile
        return Family(offset, present, length, 0.5 * (profile[: len(present)] + profile[offset:]))


def _spacing(value: Any) -> float | tuple[float, ...]:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (tuple, list)):
        return _validate.number("spacing", value, above=0.0)
    if len(value) not in (2, 3):
        raise ValueError(f"spacing must be one number, (along, up) or (along, up, across), got {value!r}")
    return tuple(_validate.number("spacing", entry, above=0.0) for entry in value)


def _particle_numbers(value: Any, size: int) -> tuple[int, ...]:
    try:
        if isinstance(value, bytes):  # whose entries are whole numbers
            raise TypeError
        numbers = tuple(sorted({_validate.count("pinned", entry, minimum=0) for entry in value}))
    except TypeError:
        raise TypeError(f"pinned must be one of {PINNED} or a tuple of particle numbers, got {value!r}") from None
    if numbers and numbers[-1] >= size:
        raise ValueError(f"pinned must hold particle numbers below {size}, got {numbers[-1]}")
    return numbers


def _read_only(value: NDArray[Any]) -> NDArray[Any]:
    value.setflags(write=False)
    return value
