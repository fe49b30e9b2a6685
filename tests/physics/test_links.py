"""Link forces of lattices of any size against a sum over grid neighbours in NumPy, which knows no chunks, blocks or families."""

from __future__ import annotations

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, effects, integrators

STIFFNESS, VISCOSITY = (100.0, 20.0, 2.0), (0.02, 0.03, 0.01)
STEPS = (((0, 0, 1), (0, 1, 0)), ((0, 1, 1), (0, 1, -1)), ((0, 0, 2), (0, 2, 0)))

SHAPES = {
    "a point": (1, 1, 1),
    "less than a chunk": (1, 3, 4),
    "a rope": (1, 1, 37),
    "a column": (1, 37, 1),
    "whole chunks": (1, 10, 16),
    "chunks and a rest": (1, 9, 13),
    "two layers": (2, 5, 7),
    "blocks": (1, 80, 128),
    "rows longer than a block": (1, 11, 4100),
}


def by_neighbours(lattice, x, v, damping):
    """Forces (layers, rows, cols, 3)."""
    share = lattice.taper_profile.reshape(lattice.shape)
    along, up, across = lattice.spacings
    total = np.zeros_like(x)
    for steps, k, c in zip(STEPS, STIFFNESS, VISCOSITY, strict=True):
        for step in steps:
            first = tuple(slice(max(-by, 0), size - max(by, 0)) for by, size in zip(step, lattice.shape, strict=True))
            second = tuple(slice(max(by, 0), size - max(-by, 0)) for by, size in zip(step, lattice.shape, strict=True))
            if not x[first].size:
                continue
            apart, speed = x[second] - x[first], v[second] - v[first]
            d = np.linalg.norm(apart, axis=-1, keepdims=True)
            length = np.linalg.norm([step[2] * along, step[0] * across, step[1] * up])
            force = k * (1 - length / d) * apart
            if damping == "isotropic":
                force += c * speed
            elif damping == "axial":
                force += c * (apart * speed).sum(axis=-1, keepdims=True) * apart / d**2
            force *= 0.5 * (share[first] + share[second])[..., None]
            total[first] += force
            total[second] -= force
    return total


@pytest.mark.parametrize("damping", ["none", "isotropic", "axial"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_every_link_pulls_both_its_ends(shape, dtype, damping):
    lattice = Lattice(*shape, spacing=0.1, mass=0.01, taper=0.3, pinned="none")
    kinds = (effects.Structural, effects.Shear, effects.Bending)
    mode = "isotropic" if damping == "none" else damping
    links = tuple(
        kind(k, 0.0 if damping == "none" else c, damping=mode, tapered=True)
        for kind, k, c in zip(kinds, STIFFNESS, VISCOSITY, strict=True)
    )
    sim = Simulator(Scene(lattice, links, integrator=integrators.Leapfrog(), dtype=dtype, timestep=1e-3))
    rng = np.random.default_rng(0)
    x = (lattice.rest_positions + 0.02 * rng.standard_normal((*shape, 3))).astype(dtype).astype(float)
    v = rng.standard_normal((*shape, 3)).astype(dtype).astype(float)
    sim.set_positions(x[None])
    sim.set_velocities(v[None])
    sim.step()
    kicked = sim.get_state().velocities[0].T.reshape(*shape, 3).astype(float)
    forces = (kicked - v) / 1e-3 * lattice.masses.reshape(*shape, 1)
    expected = by_neighbours(lattice, x, v, damping)
    assert np.abs(forces - expected).max() <= (1e-6 if dtype == "float32" else 2e-15) * (1.0 + np.abs(expected).max())
