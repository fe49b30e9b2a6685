"""What a page must know of a scene once, to draw every frame of it from positions alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from flag_env.physics import Scene, Simulator
from flag_env.physics.effects import LinkEffect
from flag_env.viewer.wire import Torn

BALL, LEAST_BALL = 0.24, 0.09
"""Radius of a mast-side particle and of the lightest one shown, in spacings (the report: 0.2, and proportional to mass)."""


def body(scene: Scene) -> dict[str, Any]:
    """Lattice, masses and link families as JSON values.

    `families` are rows of (effect, layers, rows, columns, rest length): a link of a family joins each particle to the one that
    lies so many layers, rows and columns further on.
    """
    lattice = scene.lattice
    profile = lattice.taper_profile.reshape(lattice.shape)[0, 0]
    return {
        "shape": list(lattice.shape),
        "spacing": list(lattice.spacings),
        "extent": list(lattice.extent),
        "dimensions": lattice.dimensions,
        "pinned": np.flatnonzero(lattice.fixed).tolist(),
        "radius": (min(lattice.spacings) * np.maximum(BALL * profile / profile.max(), LEAST_BALL)).round(6).tolist(),
        "families": [[type(e).__name__, *d, round(f.length, 6)] for e, d, f in _families(scene)],
        "tears": _tears(scene),
    }


def _families(scene: Scene) -> list[tuple[LinkEffect, tuple[int, int, int], Any]]:
    """Link effects with a direction and its family, those that the lattice holds."""
    lattice = scene.lattice
    return [
        (effect, direction, family)
        for effect in scene.effects
        if isinstance(effect, LinkEffect)
        for direction in effect.directions
        for family in lattice.families(direction)
    ]


def _tears(scene: Scene) -> bool:
    return any(effect.breaks for effect in scene.effects)


def torn(simulator: Simulator) -> Torn | None:
    """What holds in the first copy; None in a scene that does not tear."""
    scene = simulator.scene
    if not _tears(scene):
        return None
    links = np.zeros(scene.lattice.size, np.uint16)
    rows = (row for group in simulator.run.links for row in group.weight[0])
    for number, weight in enumerate(rows):
        links |= np.where(weight != 0, np.uint16(1 << number), np.uint16(0))
    return Torn(links, simulator.intact_cells()[0])
