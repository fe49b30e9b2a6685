"""Structural links: horizontal and vertical neighbours of each layer; they resist stretching (Provot 1995).

F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)], l = the spacing. Parameters: stiffness k [N/m], viscosity z [N s/m]; see
`LinkEffect`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flag_env.physics.effects.links import LinkEffect
from flag_env.physics.lattice import Direction


@dataclass(frozen=True)
class Structural(LinkEffect):
    """Springs and dampers between direct neighbours; parameters as in `LinkEffect`."""

    directions: ClassVar[tuple[Direction, ...]] = ((0, 0, 1), (0, 1, 0))

    stiffness: float = 500.0
    viscosity: float = 0.1

    def coarsened(self, share: float) -> Structural:
        """Springs per link stay: as many cross a width of cloth, each for a wider strip, and are longer."""
        del share
        return self
