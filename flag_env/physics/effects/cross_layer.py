"""Cross-layer links: struts between facing particles of neighbouring layers and the four space diagonals of every cube.

F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)], l = the gap between the layers or the cube's diagonal. They hold the layers apart and
resist shear in place of the face diagonals (the report's two-layer flag). Parameters: stiffness k [N/m], viscosity z [N s/m];
see `LinkEffect`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flag_env.physics.effects.links import LinkEffect
from flag_env.physics.lattice import Direction


@dataclass(frozen=True)
class CrossLayer(LinkEffect):
    """Springs and dampers between neighbouring layers; parameters as in `LinkEffect`."""

    directions: ClassVar[tuple[Direction, ...]] = ((1, 0, 0), (1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1))

    stiffness: float = 250.0
    viscosity: float = 0.05
