"""No cloth passes through cloth: the edges that pierce triangles are counted."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree

from flag_env.physics import Simulator, effects, presets
from flag_env.physics.effects import SelfCollision

CLOTH = presets.flag(12, 16)
COLLIDING = CLOTH.adding(SelfCollision())
MEAN_MASS = CLOTH.lattice.masses.mean()


def faces(shape, falling):
    """Two triangles for each cell of the cloth, cut along either diagonal."""
    n = np.arange(np.prod(shape)).reshape(shape)
    a, b, c, d = n[:, :-1, :-1], n[:, :-1, 1:], n[:, 1:, :-1], n[:, 1:, 1:]
    halves = [(a, b, c), (b, d, c)] if falling else [(a, b, d), (a, d, c)]
    return np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])


def crossings(positions, falling=False):
    """Number of (edge, triangle) pairs of one copy's cloth in which the edge pierces the triangle."""
    x = positions.reshape(-1, 3)
    triangles = faces(positions.shape[:3], falling)
    edges = np.unique(np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1), axis=0)
    centres, middles = x[triangles].mean(axis=1), x[edges].mean(axis=1)
    radius, half = (
        np.linalg.norm(x[triangles] - centres[:, None], axis=-1).max(),
        np.linalg.norm(x[edges[:, 0]] - middles, axis=-1),
    )
    near = cKDTree(middles).query_ball_point(centres, radius + half.max())
    corners = np.repeat(triangles, [len(found) for found in near], axis=0)
    ends = edges[np.concatenate([np.asarray(found, int) for found in near])]
    apart = ~(corners[:, :, None] == ends[:, None]).any(axis=(1, 2))
    (a, b, c), (p, q) = x[corners[apart]].transpose(1, 0, 2), x[ends[apart]].transpose(1, 0, 2)

    def volume(a, b, c, d):
        return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)

    sides = np.stack([volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)])
    pierces = (volume(a, b, c, p) * volume(a, b, c, q) < 0) & ((sides > 0).all(axis=0) | (sides < 0).all(axis=0))
    return int(pierces.sum())


def test_the_counter_counts():
    x = np.zeros((2, 2, 2, 3))
    x[0, ..., 0], x[0, ..., 2] = np.indices((2, 2))[::-1]
    x[1, ..., 1], x[1, ..., 2] = np.indices((2, 2))[::-1]
    x[1] += (0.4, -0.3, 0.1)  # a square through a square, at right angles
    assert crossings(x) == crossings(x[::-1]) > 0
    x[1, ..., 1] += 0.31
    assert crossings(x) == 0


def folded(lattice, gap):
    """The far half laid back beside the near one, round a bend."""
    along = lattice.rest_positions[0, 0, :, 0]
    middle, bend = along[-1] / 2, np.pi * gap / 2
    angle = np.clip((along - middle) / bend, 0, 1) * np.pi
    x = lattice.rest_positions.copy()
    x[..., 0] = np.minimum(along, middle) + gap / 2 * np.sin(angle) - np.maximum(along - middle - bend, 0)
    x[..., 1] = gap / 2 * (1 - np.cos(angle))
    return x


def drop(sim):
    lattice = sim.scene.lattice
    sim.set_positions(folded(lattice, 1.5 * max(lattice.spacings)))
    sim.set_wind(mean=(0.0, -8 * MEAN_MASS, 0.0))


def gale(sim):
    sim.set_wind(amplitude=(30 * MEAN_MASS, 40 * MEAN_MASS, 25 * MEAN_MASS), frequency=(7, 11, 9))


def breeze(sim):
    sim.set_wind(amplitude=(6 * MEAN_MASS, 8 * MEAN_MASS, 5 * MEAN_MASS), frequency=(3, 5, 4), mean=(6 * MEAN_MASS, 0, 0))


def exchange(sim):
    """One of two free layers is turned through the other."""
    v = np.zeros((*sim.scene.lattice.shape, 3))
    v[0, ..., 1] = np.linspace(5.0, -1.0, sim.scene.lattice.cols)
    sim.set_velocities(v)


def layered(scene, drag=1.5):
    """Two free layers that nothing pulls down; the same kinds of effects as `scene`, whose compiled step serves both."""
    lattice = dataclasses.replace(scene.lattice, layers=2, pinned="none")
    return scene.replace(lattice=lattice).adding(effects.Gravity(0.0), effects.AirDrag(drag))


SCENES = {"drop": (drop, CLOTH), "gale": (gale, CLOTH), "breeze": (breeze, CLOTH), "exchange": (exchange, layered(CLOTH))}


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", SCENES)
def test_no_cloth_passes_through_cloth(name, dtype):
    start, scene = SCENES[name]
    counts = []
    for more in ((), (SelfCollision(),)):
        sim = Simulator(scene.replace(dtype=dtype).adding(*more))
        start(sim)
        found = [crossings(sim.positions[0])]
        for _ in range(60):
            sim.advance(0.05)
            found.append(max(crossings(sim.positions[0], falling) for falling in (False, True)))
        counts.append(found)
    without, with_collisions = counts
    assert without[0] == 0
    assert sum(without) > 20
    assert sum(with_collisions) == 0


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_two_sheets_do_not_pass_each_other(restitution):
    sim = Simulator(layered(CLOTH).adding(SelfCollision(restitution=restitution)))
    v = np.zeros((*sim.scene.lattice.shape, 3))
    v[0, ..., 1], v[1, ..., 1] = 2.0, -1.0
    sim.set_velocities(v)
    for _ in range(40):
        sim.advance(0.01)
        y = sim.positions[0, ..., 1]
        assert (y[1] - y[0]).min() > 0
    rate = np.average(sim.velocities[0, ..., 1], axis=(1, 2), weights=sim.scene.lattice.masses.reshape(2, 12, 16)[0])
    slowed = np.exp(-next(e.rate for e in sim.scene.effects if isinstance(e, effects.AirDrag)) * 0.4)  # by the air
    assert rate[1] - rate[0] == pytest.approx(3.0 * restitution * slowed, abs=0.1)
