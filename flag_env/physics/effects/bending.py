"""Bending links: second neighbours along rows and along columns of each layer; they resist folding (Provot 1995).

F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)], l = twice the spacing. Parameters: stiffness k [N/m], viscosity z [N s/m]; see
`LinkEffect`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flag_env.physics.effects.links import LinkEffect
from flag_env.physics.lattice import Direction


@dataclass(frozen=True)
class Bending(LinkEffect):
    """Springs and dampers between second neighbours; parameters as in `LinkEffect`."""

    directions: ClassVar[tuple[Direction, ...]] = ((0, 0, 2), (0, 2, 0))

    stiffness: float = 50.0
    viscosity: float = 0.01

    def coarsened(self, share: float) -> Bending:
        """Springs per link stay: as many cross a width of cloth, each for a wider strip, and are longer."""
        del share
        return self
