"""Error of space: one flag on lattices of 8 x 5 to 64 x 40 particles, against the finest.

`presets.flag` keeps size, areal density and, for structural and shear links, stiffness per width (a square mesh of springs k
stretches alike however fine it is); the wind is given as a force per area. Bending is held here too. A link k between second
neighbours at spacing a, bent to the curvature c with structural links unstretched, is 2 a cos(a c / 2) long, a^3 c^2 / 4 short
of its rest length, and there is one to each area a b: an energy of k a^5 c^4 / (32 b) per area, of which nothing is linear. So k
falls as a^-4 where lattices get coarser. In the plane the same links add 4 k to the stiffness per width, since two of them cross
every section of a row and each is stretched along 2 a: what bending links lose, structural links gain. The finest lattice has the
links of `presets.flag`; a still finer one could not hold both, as its bending links alone would stretch less than the cloth may.

Poses are compared at the material points of the coarsest lattice, between
particles by bilinear interpolation. LFAB at half its limit: the error of time is far below that of space.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from flag_env.physics import Scene, Simulator, presets
from flag_env.physics.effects import Bending, CosineWind, Structural
from flag_env.physics.integrators import LFAB
from flag_env.studies.accuracy_scenes import stepped

SIZES = ((5, 8), (10, 16), (20, 32), (40, 64))
"""(rows, cols), the finest last."""

TIMES = (0.5, 1.0, 2.0)
"""Instants of comparison [s]."""

WIND = CosineWind((2.0, 4.0, 2.0), (5.0, 7.0, 3.0), (6.0, 1.5, 0.0))
"""In m/s^2 of the mean particle's mass."""

Array = NDArray[np.float64]


def held(flag: Scene) -> Scene:
    """A `presets.flag` with the stiffness against stretching and bending that it has on the finest lattice."""
    finest = presets.flag(*SIZES[-1]).lattice
    share = (math.prod(finest.spacings[:2]) / math.prod(flag.lattice.spacings[:2])) ** 2
    links = {type(effect): effect for effect in flag.effects}
    structural, bending = links[Structural], links[Bending]
    assert isinstance(structural, Structural)
    assert isinstance(bending, Bending)
    moved = (1.0 - share) * bending.stiffness
    return flag.adding(
        replace(structural, stiffness=structural.stiffness + 4.0 * moved), replace(bending, stiffness=bending.stiffness - moved)
    )


def scene(rows: int, cols: int) -> Scene:
    """The flag at this resolution, of the same material, in the same wind."""
    flag = held(presets.flag(rows, cols, integrator=LFAB(), perturbation=0.0))
    force = float(flag.lattice.masses.mean())
    wind = replace(WIND, amplitude=tuple(force * a for a in WIND.amplitude), mean=tuple(force * a for a in WIND.mean))
    return stepped(flag.adding(wind), 0.5, TIMES[0])


def poses(rows: int, cols: int) -> dict[str, Any]:
    """Positions at `TIMES` of the coarsest lattice's material points, and what they cost."""
    simulator = Simulator(scene(rows, cols))
    start = simulator.get_state()
    simulator.step(1)
    simulator.set_state(start)
    spent, found = 0.0, []
    for before, now in zip((0.0, *TIMES), TIMES, strict=False):
        begin = time.perf_counter()
        simulator.advance(now - before)
        spent += time.perf_counter() - begin
        found.append(resampled(simulator.positions[0, 0], *SIZES[0]))
    return {"poses": np.array(found).tolist(), "seconds": spent / TIMES[-1], "timestep": simulator.timestep}


def resampled(positions: Array, rows: int, cols: int) -> Array:
    """Positions (..., up, along, 3) at the material points of a lattice of rows x cols particles, by bilinear interpolation."""
    up, along = positions.shape[-3:-1]
    if (up, along) == (rows, cols):
        return positions
    grid = np.linspace(0, 1, up), np.linspace(0, 1, along)
    points = np.stack(np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, cols), indexing="ij"), axis=-1)
    last = np.moveaxis(positions, (-3, -2), (0, 1))
    return np.moveaxis(RegularGridInterpolator(grid, last)(points), (0, 1), (-3, -2))


def table(found: list[dict[str, Any]], sizes: tuple[tuple[int, int], ...]) -> list[dict[str, Any]]:
    """One row a lattice: RMS distance to the finest at each instant, and wall time."""
    finest = np.array(found[-1]["poses"])
    rows = []
    for (up, along), result in zip(sizes, found, strict=True):
        apart = np.linalg.norm(np.array(result["poses"]) - finest, axis=-1)
        rms = np.sqrt((apart**2).mean(axis=(1, 2)))
        rows.append(
            {
                "lattice": f"{along} x {up}",
                **{f"RMS at {t:g} s [mm]": float(1e3 * value) for t, value in zip(TIMES, rms, strict=True)},
                "timestep [s]": result["timestep"],
                "wall time per simulated s": result["seconds"],
            }
        )
    return rows
