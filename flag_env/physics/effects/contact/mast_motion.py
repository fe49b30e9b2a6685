"""Where the cloth is beside the pole, and where it was at the start of the step.

Coordinates in the pole's frame: two across it and the height above its foot. There the pole stands still.
"""

from __future__ import annotations

import numpy as np

from flag_env.physics.compiling import jit, kernel


@kernel
def trace(x, y, z, u, v, w, foot, across, beside, up, speed, turn, inverse, h, px, py, pz, qx, qy, qz, n):
    """Write coordinates in the pole's frame at the end of a step of `h` seconds, p, and at its start, q."""
    for t in range(n):
        dx = x[t] - foot[0]
        dy = y[t] - foot[1]
        dz = z[t] - foot[2]
        height = dx * up[0] + dy * up[1] + dz * up[2]
        share = height * inverse
        du = (u[t] - speed[0] - share * turn[0]) * h
        dv = (v[t] - speed[1] - share * turn[1]) * h
        dw = (w[t] - speed[2] - share * turn[2]) * h
        a = dx * across[0] + dy * across[1] + dz * across[2]
        b = dx * beside[0] + dy * beside[1] + dz * beside[2]
        px[t] = a
        py[t] = b
        pz[t] = height
        qx[t] = a - (du * across[0] + dv * across[1] + dw * across[2])
        qy[t] = b - (du * beside[0] + dv * beside[1] + dw * beside[2])
        qz[t] = height - (du * up[0] + dv * up[1] + dw * up[2])


@kernel
def retrace(x, y, z, foot, across, beside, up, radius, px, py, pz, qx, qy, reach, n):
    """Write the coordinates at the end of the step anew, and how far from there a particle as thick as the pole has been."""
    for t in range(n):
        dx = x[t] - foot[0]
        dy = y[t] - foot[1]
        dz = z[t] - foot[2]
        a = dx * across[0] + dy * across[1] + dz * across[2]
        b = dx * beside[0] + dy * beside[1] + dz * beside[2]
        px[t] = a
        py[t] = b
        pz[t] = dx * up[0] + dy * up[1] + dz * up[2]
        a -= qx[t]
        b -= qy[t]
        reach[t] = radius + np.sqrt(a * a + b * b)


@kernel
def _measure(x, y, z, u, v, w, foot, across, beside, speed, turn, up, inverse, radius, h, px, py, reach, n):
    """Write coordinates across the pole, and how far from there a particle as thick as the pole may have been in the step."""
    for t in range(n):
        dx = x[t] - foot[0]
        dy = y[t] - foot[1]
        dz = z[t] - foot[2]
        share = (dx * up[0] + dy * up[1] + dz * up[2]) * inverse
        du = u[t] - speed[0] - share * turn[0]
        dv = v[t] - speed[1] - share * turn[1]
        dw = w[t] - speed[2] - share * turn[2]
        px[t] = dx * across[0] + dy * across[1] + dz * across[2]
        py[t] = dx * beside[0] + dy * beside[1] + dz * beside[2]
        reach[t] = radius + h * np.sqrt(du * du + dv * dv + dw * dw)


@kernel
def _count_near(px, py, reach, pxb, pyb, reach_b, edge, n):
    """Number of edges that may have come nearer than R to the axis: |middle| < R + |e| / 2, or a.b < R^2 + R |e|."""
    near = 0
    for t in range(n):
        far = max(reach[t], reach_b[t])
        ex = pxb[t] - px[t]
        ey = pyb[t] - py[t]
        spare = px[t] * pxb[t] + py[t] * pyb[t] - far * far - far * np.sqrt(ex * ex + ey * ey)
        near += (spare <= 0) & (edge[t] != 0)
    return near


@jit
def edges_near(data, x, v, foot, frame, pole, h, px, py, reach):
    """Whether an edge may have come near the axis in the step; where none has, no face and no particle has either."""
    n = x.shape[1]
    across, beside, up = frame
    speed, turn, inverse = pole
    _measure(x[0], x[1], x[2], v[0], v[1], v[2], foot, across, beside, speed, turn, up, inverse, data.radius, h, px, py, reach, n)
    for family in range(data.offset.shape[0]):
        o = data.offset[family]
        if _count_near(px, py, reach, px[o:], py[o:], reach[o:], data.edge[family], n - o):
            return True
    return False
