"""The flag that a good user of Numba would write: one loop over particles, a gather over twelve neighbours.

The baseline of the speed study. It simulates the same scene as `presets.flag` does without drag and wind, and shares no code with
the package but the scene's description.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from flag_env.physics import Scene, effects, presets
from flag_env.physics.integrators import Leapfrog

NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))


def springs(rows: int, cols: int, dtype: str, **scene: Any) -> Scene:
    """A flag with gravity and the three kinds of springs, stepped as the loop below by default."""
    return presets.flag(rows, cols, dtype=dtype, **{"integrator": Leapfrog(), **scene}).without(
        effects.AirDrag, effects.CosineWind
    )


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _steps(
    x: Any, v: Any, f: Any, neighbour: Any, k: Any, z: Any, length: Any, inverse_mass: Any, g: Any, h: Any, steps: int
) -> None:
    one = x.dtype.type(1)
    for _ in range(steps):
        for i in range(x.shape[0]):
            fx = fy = fz = x.dtype.type(0)
            for m in range(neighbour.shape[1]):
                j = neighbour[i, m]
                if j < 0:
                    break
                dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
                a = k[i, m] * (one - length[i, m] / np.sqrt(dx * dx + dy * dy + dz * dz))
                fx += a * dx + z[i, m] * (v[j, 0] - v[i, 0])
                fy += a * dy + z[i, m] * (v[j, 1] - v[i, 1])
                fz += a * dz + z[i, m] * (v[j, 2] - v[i, 2])
            f[i, 0], f[i, 1], f[i, 2] = fx, fy, fz
        for i in range(x.shape[0]):
            if inverse_mass[i] > 0:
                v[i, 0] += h * inverse_mass[i] * f[i, 0]
                v[i, 1] += h * inverse_mass[i] * f[i, 1]
                v[i, 2] += h * (inverse_mass[i] * f[i, 2] - g)
                for d in range(3):
                    x[i, d] += h * v[i, d]


class PlainFlag:
    """A flag of rows x cols particles.

    Parameters
    ----------
    rows, cols
        Particles up and along.
    spacing
        Distance of neighbours along and up [m].
    masses : (rows * cols,)
        [kg].
    stiffness, viscosity
        Of structural, shear and bending links [N/m], [N s/m]; they follow the mass taper.
    timestep
        [s].
    dtype
        "float32" or "float64".
    """

    def __init__(
        self,
        rows: int,
        cols: int,
        spacing: tuple[float, float],
        masses: Any,
        stiffness: tuple[float, float, float],
        viscosity: tuple[float, float, float],
        timestep: float,
        dtype: str,
    ) -> None:
        number = np.dtype(dtype).type
        size = rows * cols
        shape = size, 2 * len(NEIGHBOURS)
        self.neighbour = np.full(shape, -1, np.int32)
        self.k, self.z, self.length = (np.zeros(shape, dtype) for _ in range(3))
        taper = masses / masses[0]
        for i in range(size):
            row, col = divmod(i, cols)
            found = 0
            for kind, (up, along) in enumerate(NEIGHBOURS):
                for sign in (1, -1):
                    r, c = row + sign * up, col + sign * along
                    if 0 <= r < rows and 0 <= c < cols:
                        j = r * cols + c
                        weight = 0.5 * (taper[i] + taper[j])
                        self.neighbour[i, found] = j
                        self.k[i, found] = weight * stiffness[kind // 2]
                        self.z[i, found] = weight * viscosity[kind // 2]
                        self.length[i, found] = np.hypot(along * spacing[0], up * spacing[1])
                        found += 1
        up_index, along_index = np.divmod(np.arange(size), cols)
        self.x = np.stack([along_index * spacing[0], 0.0 * along_index, up_index * spacing[1]], axis=1).astype(dtype)
        self.v, self.f = np.zeros_like(self.x), np.zeros_like(self.x)
        self.inverse_mass = np.where(along_index == 0, 0.0, 1.0 / masses).astype(dtype)
        self.g, self.h = number(9.81), number(timestep)

    def step(self, steps: int) -> None:
        """Take `steps` steps."""
        _steps(
            self.x, self.v, self.f, self.neighbour, self.k, self.z, self.length, self.inverse_mass, self.g, self.h, steps
        )  # fmt: skip
