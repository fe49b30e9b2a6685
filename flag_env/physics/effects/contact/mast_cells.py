"""Cloth between the particles against the pole: the order in which `MastCollision` treats edges and faces of cells.

What neither edges nor the pole's ends have passed, the axis does not pierce.
"""

from __future__ import annotations

from flag_env.physics.compiling import jit
from flag_env.physics.effects.contact.mast_edges import treat_edges
from flag_env.physics.effects.contact.mast_faces import treat_ends

ITERATIONS = 30
"""Most passes over all faces and edges in a step: a push may put the next edge in."""

SHALLOW = 0.01
"""Depth, in radii, that calls for no further pass."""


@jit
def keep_cells_out(data, links, x, v, w, frame, p, q, reach, pole, low, high):
    """Keep edges and faces of whole cells out of the pole."""
    for _ in range(ITERATIONS):
        moved = treat_ends(data, links, x, v, w, frame, p, q, reach, pole, low, high)
        moved += treat_edges(data, links, x, v, w, frame, p, q, reach, pole, low, high)
        if moved == 0:
            break
