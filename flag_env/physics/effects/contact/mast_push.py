"""What both edges and faces against the pole need: which cells are whole, and the push of a point of the cloth."""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit


@jit
def is_whole(links, cols, cell):
    """Whether all four sides of a cell are whole; `cell` is its first particle."""
    return (
        cell >= 0
        and cell + cols + 1 < links.shape[1]
        and cell % cols != cols - 1
        and links[0, cell] != 0
        and links[0, cell + cols] != 0
        and links[1, cell] != 0
        and links[1, cell + 1] != 0
    )


@jit
def push(x, v, w, frame, p, corner, share, height, normal, depth, pole, bounce, friction):
    """Move three particles, by shares that make up a point of the cloth, so that it is `depth` further along `normal`.

    Its approach to the pole stops and its sliding is braked, as a particle's is.
    """
    zero = depth * 0
    one = zero + type(depth)(1)
    across, beside, up = frame
    foot_speed, turn, inverse = pole
    give = zero
    for k in range(3):
        give += w[corner[k]] * share[k] * share[k]
    if not give > 0:
        return
    u = (zero, zero, zero)
    for k in range(3):
        t = corner[k]
        u = (u[0] + share[k] * v[0, t], u[1] + share[k] * v[1, t], u[2] + share[k] * v[2, t])
    along = height * inverse
    u = (
        u[0] - foot_speed[0] - along * turn[0],
        u[1] - foot_speed[1] - along * turn[1],
        u[2] - foot_speed[2] - along * turn[2],
    )
    m = (
        normal[0] * across[0] + normal[1] * beside[0] + normal[2] * up[0],
        normal[0] * across[1] + normal[1] * beside[1] + normal[2] * up[1],
        normal[0] * across[2] + normal[1] * beside[2] + normal[2] * up[2],
    )
    change = (zero, zero, zero)
    rate = u[0] * m[0] + u[1] * m[1] + u[2] * m[2]
    if rate < 0:
        slide = (u[0] - rate * m[0], u[1] - rate * m[1], u[2] - rate * m[2])
        size = np.sqrt(slide[0] * slide[0] + slide[1] * slide[1] + slide[2] * slide[2])
        brake = min(-friction * bounce * rate / size, one) if size > 0 else zero
        change = (
            -bounce * rate * m[0] - brake * slide[0],
            -bounce * rate * m[1] - brake * slide[1],
            -bounce * rate * m[2] - brake * slide[2],
        )
    for k in range(3):
        t = corner[k]
        part = w[t] * share[k] / give
        for d in range(3):
            x[d, t] += part * depth * m[d]
            v[d, t] += part * change[d]
            p[d][t] += part * depth * normal[d]
