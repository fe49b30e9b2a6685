"""Bending links: second neighbours along rows and along columns of each layer; they resist folding (Provot 1995).

F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)], l = twice the spacing. Parameters: stiffness k [N/m], viscosity z [N s/m]; see
`LinkEffect`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flag_env.physics.effects.springs import LinkEffect
from flag_env.physics.lattice import Step


@dataclass(frozen=True)
class Bending(LinkEffect):
    """Springs and dampers between second neighbours; parameters as in `LinkEffect`."""

    steps: ClassVar[tuple[Step, ...]] = ((0, 0, 2), (0, 2, 0))

    stiffness: float = 50.0
    viscosity: float = 0.01
