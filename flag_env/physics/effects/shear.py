"""Shear links: both diagonals of every cell of each layer; they resist skewing (Provot 1995).

F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)], l = the cell's diagonal. Parameters: stiffness k [N/m], viscosity z [N s/m]; see
`LinkEffect`. The report's two-layer flag has none: there the cube diagonals of `CrossLayer` take their place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flag_env.physics.effects.springs import LinkEffect
from flag_env.physics.lattice import Step


@dataclass(frozen=True)
class Shear(LinkEffect):
    """Springs and dampers along the face diagonals; parameters as in `LinkEffect`."""

    steps: ClassVar[tuple[Step, ...]] = ((0, 1, 1), (0, 1, -1))

    stiffness: float = 250.0
    viscosity: float = 0.05
