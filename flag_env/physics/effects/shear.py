"""Shear links: both diagonals of every cell of each layer; they resist skewing (Provot 1995).

F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)], l = the cell's diagonal. Parameters: stiffness k [N/m], viscosity z [N s/m]; see
`LinkEffect`. The report's two-layer flag has none: there the cube diagonals of `CrossLayer` take their place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flag_env.physics.effects.links import LinkEffect
from flag_env.physics.lattice import Direction


@dataclass(frozen=True)
class Shear(LinkEffect):
    """Springs and dampers along the face diagonals; parameters as in `LinkEffect`."""

    directions: ClassVar[tuple[Direction, ...]] = ((0, 1, 1), (0, 1, -1))

    stiffness: float = 250.0
    viscosity: float = 0.05

    def coarsened(self, share: float) -> Shear:
        """Springs per link stay: as many cross a width of cloth, each for a wider strip, and are longer."""
        del share
        return self
