"""Checks self-collision against brute force, the conservation laws, and a count of cloth that passes through cloth."""

import dataclasses
import pickle

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from flag_env.physics import Diverged, Lattice, Scene, Simulator, effects, integrators, max_timestep, presets
from flag_env.physics.effects import SelfCollision
from flag_env.physics.effects.base import BindContext
from flag_env.physics.effects.contact import cells
from flag_env.physics.effects.contact.blocks import find_pairs_by_blocks

CLOTH = presets.flag(12, 16)
COLLIDING = CLOTH.adding(SelfCollision())
BEADS = Lattice(1, 5, 8, 0.1, 0.02, 0.3, "none")  # without springs: particles that only collide
MEAN_MASS = CLOTH.lattice.masses.mean()


# -- crossings ------------------------------------------------------------------------------------------------------------------


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


# -- pairs ----------------------------------------------------------------------------------------------------------------------


def bound_to(effect, lattice, dtype="float64"):
    return effect.bind(BindContext(lattice, np.dtype(dtype), copies=1, timestep=1e-3, seed=0))


def listed_pairs(x, data):
    """Pairs that the cell lists find in x (particles, 3); None if they do not fit the list."""
    dtype = data.rest.dtype
    x = np.ascontiguousarray(x.T, dtype)
    effect_work = np.empty_like(x)
    where = data.start[0], data.place[0], data.order[0], data.column[0]
    finite = cells.sort_into_cells(*x, data.per_cell, *where, *effect_work, x.shape[1])
    one, two = data.pairs[0]
    count, searched = cells.find_pairs(*effect_work, data.per_cell, *where, data.code, data.free, data.reach, 0, one, two, finite)
    if searched < finite:
        return None
    pairs = np.sort(np.stack([one[:count], two[:count]], axis=1).astype(int), axis=1)
    assert len(np.unique(pairs, axis=0)) == count  # none twice
    return {tuple(pair) for pair in pairs}


def brute_pairs(x, lattice, reach):
    """The same from all pairs of x, in its own precision; neighbours are those within a cell's diagonal in one layer."""
    rest = lattice.rest_positions.reshape(-1, 3)
    i, j = np.triu_indices(len(x), 1)
    with np.errstate(invalid="ignore", over="ignore"):
        d = x[j] - x[i]
        near = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] + d[:, 2] * d[:, 2] < reach * reach
    linked = (rest[i, 1] == rest[j, 1]) & (pdist(rest) < 1.01 * np.hypot(*lattice.spacings[:2]))
    return set(zip(i[near & ~linked].tolist(), j[near & ~linked].tolist(), strict=True))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("spacing", [0.1, (0.04, 0.1), (0.1, 0.03, 0.2)])
@pytest.mark.parametrize("shape", [(1, 12, 16), (2, 5, 9), (1, 1, 40), (1, 2, 2), (3, 7, 1)])
def test_cells_find_the_pairs_that_brute_force_finds(shape, spacing, dtype):
    lattice = Lattice(*shape, spacing, pinned="none")
    data = bound_to(SelfCollision(), lattice, dtype)
    random = np.random.default_rng(0)
    seen = 0
    for spread in (0.02, 0.1, 0.3, 1.0):
        for shift in (0.0, -7.3, 1e3):
            x = (shift + spread * random.standard_normal((lattice.size, 3))).astype(dtype)
            x[: len(x) // 8] += np.array([1e9, -1e9, 1e5], dtype)  # far outside, most of them in one place
            x[len(x) // 2] = x[-1]  # coincident
            found, expected = listed_pairs(x, data), brute_pairs(x, lattice, data.reach)
            if found is None:
                assert len(expected) > data.pairs.shape[2] - lattice.size
                continue
            assert found == expected
            seen += len(found)
    assert seen > 0 or lattice.size == 4


def test_cells_find_neighbours_across_borders_and_leave_out_what_is_not_finite():
    lattice = Lattice(1, 8, 8, 0.1, pinned="none")
    data = bound_to(SelfCollision(), lattice)
    grid = np.stack(np.meshgrid(*[np.arange(-2, 2) * float(1 / data.per_cell)] * 3), axis=-1).reshape(-1, 3)
    for scale in (1.0, 0.999, np.nextafter(0.999, 0), 0.7, 0.5):
        assert listed_pairs(scale * grid, data) == brute_pairs(scale * grid, lattice, data.reach)
    grid[[3, 20, 41]] = [[np.nan, 0, 0], [0, np.inf, 0], [-np.inf, np.nan, 1e308]]
    grid[[5, 6]] = [[1e300, -1e300, 1e300], [1e300, -1e300, 1e300]]
    assert listed_pairs(0.5 * grid, data) == brute_pairs(0.5 * grid, lattice, data.reach)


def crumpled(lattice, seed, size):
    """A smooth random pose in which far parts meet; `size` is about its extent in rest extents."""
    random = np.random.default_rng(seed)
    x = lattice.rest_positions.copy()
    phase = x[..., [0]] * random.uniform(3, 9) + x[..., [2]] * random.uniform(3, 9) + random.uniform(0, 6, 3)
    return (size * x + 0.05 * np.cos(phase) + 0.004 * random.standard_normal(x.shape)).reshape(-1, 3)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("spacing", [0.05, (0.02, 0.05), (0.06, 0.02, 0.1)])
@pytest.mark.parametrize("shape", [(1, 12, 16), (2, 7, 9), (3, 4, 4), (1, 5, 2), (1, 9, 31)])
def test_blocks_find_the_pairs_that_brute_force_finds(shape, spacing, dtype):
    lattice = Lattice(*shape, spacing, pinned="none")
    data = bound_to(SelfCollision(), lattice, dtype)
    suited = 0
    for seed in range(8):
        for size in (1.0, 0.6, 0.2):
            x = crumpled(lattice, seed, size).astype(dtype)
            pairs = np.zeros_like(data.pairs[0])
            where = data.start[0], data.place[0], data.order[0], data.column[0]
            rows = np.ascontiguousarray(x.T)
            count = find_pairs_by_blocks(rows, data.blocks, data.code, data.free, data.reach, *where, pairs, np.empty_like(rows))
            if count < 0:
                continue
            suited += 1
            found = np.sort(pairs[:, :count].T.astype(int), axis=1)
            assert len(np.unique(found, axis=0)) == count
            assert {tuple(pair) for pair in found} == brute_pairs(x, lattice, data.reach)
    assert suited > 6 or lattice.size < 50


def test_torn_and_stretched_cloth_is_searched_too():
    """Where blocks do not suit, a run finds what brute force finds."""
    sim = Simulator(COLLIDING.replace(perturbation=0.0))
    x = CLOTH.lattice.rest_positions.copy()
    x[:, 6:, :, 0] += 3.0  # torn in two, one half
    x[:, 9:, :] += (-0.1, 0.05, -0.3)  # and folded
    sim.set_positions(x)
    sim.step()
    data = sim.run.effects[-1]
    found = {tuple(sorted(pair)) for pair in data.pairs[0, :, : data.listed_pairs[0]].T.astype(int).tolist()}
    assert found == brute_pairs(data.listed[0].T, CLOTH.lattice, data.reach)
    assert found


# -- laws -----------------------------------------------------------------------------------------------------------------------


def crowd(sim, seed=0, spread=0.12, speed=1.0):
    """Place the particles at random, close to each other."""
    random = np.random.default_rng(seed)
    shape = (*sim.scene.lattice.shape, 3)
    sim.set_positions(spread * random.standard_normal(shape))
    sim.set_velocities(speed * random.standard_normal(shape))


def momentum(sim):
    return np.einsum("i,ik->k", sim.scene.lattice.masses, sim.velocities[0].reshape(-1, 3))


def test_contact_keeps_momentum_and_the_centre_of_mass():
    sim = Simulator(Scene(BEADS, (SelfCollision(0.15, friction=0.5, restitution=0.3),), timestep=1e-3))
    crowd(sim)
    before, start = momentum(sim), np.average(sim.positions[0].reshape(-1, 3), axis=0, weights=BEADS.masses)
    sim.step(300)
    np.testing.assert_allclose(momentum(sim), before, rtol=0, atol=1e-13)
    centre = np.average(sim.positions[0].reshape(-1, 3), axis=0, weights=BEADS.masses)
    np.testing.assert_allclose(centre, start + 0.3 * before / BEADS.masses.sum(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.7])
def test_contact_makes_no_kinetic_energy(friction, restitution):
    sim = Simulator(Scene(BEADS, (SelfCollision(0.15, friction, restitution),), timestep=1e-3))
    crowd(sim)
    first = last = sim.energy()["kinetic"][0]
    for _ in range(200):
        sim.step()
        now = sim.energy()["kinetic"][0]
        assert now <= last * (1 + 1e-12)
        last = now
    assert last < 0.95 * first


@pytest.mark.parametrize("friction", [0.0, 0.2, 5.0])
@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_two_particles_collide_as_in_the_formulas(friction, restitution):
    """Impulse along the line of centres, Coulomb friction across it, in closed form."""
    lattice = Lattice(1, 1, 4, 0.5, 0.02, 0.4, "none")
    sim = Simulator(Scene(lattice, (SelfCollision(0.1, friction, restitution),), timestep=1e-3))
    x, v = np.zeros((2, 1, 1, 4, 3))
    x[0, 0, :, 0] = 0.0, 3.0, 6.0, 0.0995
    v[0, 0, 0], v[0, 0, 3] = (1.0, 0.0, 0.5), (-1.0, 0.3, 0.0)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.step()
    inverse = 1 / lattice.masses[[0, 3]]
    gap = x[0, 0, 3] + 1e-3 * v[0, 0, 3] - x[0, 0, 0] - 1e-3 * v[0, 0, 0]
    n, rate = gap / np.linalg.norm(gap), v[0, 0, 3] - v[0, 0, 0]
    impulse = -(1 + restitution) * (rate @ n) / inverse.sum()
    slide = rate - (rate @ n) * n
    size = np.linalg.norm(slide)
    total = impulse * n - min(friction * impulse, size / inverse.sum()) * slide / size
    np.testing.assert_allclose(sim.velocities[0, 0, 0, [0, 3]], v[0, 0, [0, 3]] + np.outer([-inverse[0], inverse[1]], total))
    now = sim.positions[0, 0, 0]
    assert np.linalg.norm(now[3] - now[0]) == pytest.approx(0.1, rel=1e-12)
    np.testing.assert_array_equal(sim.velocities[0, 0, 0, 1:3], 0)


def test_pinned_particles_stay_and_stop_what_hits_them():
    lattice = Lattice(1, 1, 4, 0.5, 0.02, pinned=(0,))
    sim = Simulator(Scene(lattice, (SelfCollision(0.1),), timestep=1e-3))
    x, v = np.zeros((2, 1, 1, 4, 3))
    x[0, 0, :, 0] = 0.0, 3.0, 6.0, 0.2
    v[0, 0, 3, 0] = -1.0
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.step(300)
    np.testing.assert_array_equal(sim.positions[0, 0, 0, 0], 0)
    np.testing.assert_allclose(sim.positions[0, 0, 0, 3], (0.1, 0, 0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(sim.velocities[0, 0, 0, 3], 0, rtol=0, atol=1e-12)


def test_energy_does_not_grow_when_sheets_meet():
    scene = layered(CLOTH, drag=0.0).adding(SelfCollision(friction=0.0)).replace(timestep=2e-4)
    sim = Simulator(scene)
    v = np.zeros((*scene.lattice.shape, 3))
    v[0, ..., 1] = 2.0
    sim.set_velocities(v)
    energies = []
    for _ in range(100):
        energies.append(sum(value[0] for value in sim.energy().values()))
        sim.step(20)
    assert min(energies) < 0.8 * energies[0]
    assert np.diff(energies).max() < 2e-3 * energies[0]


@pytest.mark.parametrize("share", [0.5, 0.7])
@pytest.mark.parametrize("speed", [5.0, 20.0, 60.0])
def test_undamped_cloth_that_bounces_as_much_as_is_allowed_gains_no_energy(speed, share):
    """Without friction, damping and air, thrown at random: contact may only take energy out."""
    flag = presets.flag(8, 10, viscosity=0.0, drag=0.0).without(effects.CosineWind)
    scene = flag.replace(lattice=dataclasses.replace(flag.lattice, layers=2, pinned="none")).adding(effects.Gravity(0.0))
    scene = scene.adding(SelfCollision(friction=0.0, restitution=0.7))
    sim = Simulator(scene.replace(timestep=share * max_timestep(scene)))
    sim.set_velocities(speed * np.random.default_rng(0).standard_normal((*scene.lattice.shape, 3)) / 2)
    first = sum(value[0] for value in sim.energy().values())
    for _ in range(40):
        sim.step(250)
        assert sum(value[0] for value in sim.energy().values()) < 1.05 * first


# -- fine, thick and fast ------------------------------------------------------------------------------------------------------


def closing(lattice, gap, closing_speed, shift=(0.0, 0.0), **options):
    """Two layers without springs, `gap` apart and moving against each other, one shifted along x and z."""
    sim = Simulator(Scene(lattice, (SelfCollision(**options),), timestep=1e-3))
    x, v = np.zeros((2, *lattice.shape, 3))
    x[:] = lattice.rest_positions
    x[0, ..., 1], x[1, ..., 1] = 0.0, gap
    x[1, ..., [0, 2]] += np.reshape(shift, (2, 1, 1))
    v[0, ..., 1], v[1, ..., 1] = closing_speed / 2, -closing_speed / 2
    sim.set_positions(x)
    sim.set_velocities(v)
    return sim


def test_no_pair_of_a_fine_mesh_is_left_out():
    """Spacings of 5 cm and 2.5 mm: some 80 particles within reach of each."""
    sim = closing(Lattice(2, 40, 30, (0.05, 0.0025), 1e-3, pinned="none"), 0.1, 1.0)
    for _ in range(30):
        sim.step(10)
        y = sim.positions[0, ..., 1]
        assert (y[1] > y[0]).all()
        assert np.median(y[1] - y[0]) > 0.02


def test_the_list_holds_the_rest_pose_of_any_mesh():
    for scene in (presets.storm_flag(rows=100, cols=12), presets.two_layer_flag(12, 16).adding(SelfCollision(0.4))):
        sim = Simulator(scene.replace(perturbation=0.0))
        sim.step()
        (data,) = [run for run in sim._run.effects if hasattr(run, "listed_pairs")]
        assert data.listed_pairs[0] == len(brute_pairs(data.listed[0].T, scene.lattice, data.reach)) > 0


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_pairs_that_no_list_holds_are_treated_in_parts_to_the_same_bits(dtype):
    """A list of one place a particle against one that holds any two."""
    random = np.random.default_rng(0)
    n = BEADS.size
    x, v = np.ascontiguousarray(random.standard_normal((2, 3, n)), dtype)
    ends = []
    for places in (n, n * (n - 1) // 2):
        data = bound_to(SelfCollision(0.15, restitution=0.3), BEADS, dtype)
        data = data._replace(pairs=np.zeros((1, 2, places), np.uint32))
        p, u = 0.12 * x, v.copy()
        inverse_mass, effect_work = (1 / BEADS.masses).astype(dtype), np.zeros((6, 2 * n), dtype)
        for _ in range(40):
            p += np.asarray(1e-3, dtype) * u
            data.project(data, 0, p, u, effect_work, inverse_mass, 1e-3)
            ends.append((p.copy(), u.copy()))
        assert (data.listed_pairs[0] < 0) == (places == n)
    np.testing.assert_array_equal(ends[:40], ends[40:])


def test_a_crowd_in_one_place_is_parted_whole():
    """Far more pairs than any list holds: all particles of a fine cloth within one thickness."""
    lattice = Lattice(1, 30, 30, 0.01, 1e-3, pinned="none")
    sim = Simulator(Scene(lattice, (SelfCollision(),), timestep=1e-3))
    x = 0.002 * np.random.default_rng(0).standard_normal((*lattice.shape, 3))
    sim.set_positions(x)
    sim.step()
    assert sim._run.effects[0].listed_pairs[0] == -1
    sim.step(1000)
    apart = pdist(sim.positions[0].reshape(-1, 3))
    linked = pdist(lattice.rest_positions.reshape(-1, 3)) < 1.005 * np.hypot(0.01, 0.01)
    assert apart[~linked].min() > 0.8 * 0.7 * 0.02


@pytest.mark.parametrize("spacing", [0.1])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_sheets_that_approach_by_a_tenth_of_a_thickness_a_step_hardly_ever_cross(spacing, friction):
    """However they lie: the particles of one before the middles of the other's cells are the hardest."""
    lattice = Lattice(2, 12, 12, spacing, 1e-3, pinned="none")
    thickness = SelfCollision().reach(lattice)
    along, up, _ = lattice.spacings
    random, crossed = np.random.default_rng(0), 0
    for trial in range(20):
        shift = (along / 2, up / 2) if trial == 0 else random.uniform(0, 1, 2) * (along, up)
        sim = closing(lattice, thickness * random.uniform(1.0, 1.5), 0.1 * thickness / 1e-3, shift, friction=friction)
        for _ in range(6):
            sim.step()
            crossed += crossings(sim.positions[0]) > 0
    assert crossed <= 6  # of 120 looks


def test_contact_changes_angular_momentum_by_little():
    """By less than one percent of the particles' own, |x| m |v| summed up."""
    for friction in (0.0, 0.3):
        sim = Simulator(Scene(BEADS, (SelfCollision(0.15, friction=friction),), timestep=1e-3))
        crowd(sim, spread=0.3, speed=0.5)
        masses = BEADS.masses[:, None]

        def turning(sim=sim, masses=masses):
            x, v = sim.positions[0].reshape(-1, 3), sim.velocities[0].reshape(-1, 3)
            x = x - (masses * x).sum(axis=0) / masses.sum()
            return np.cross(x, masses * v).sum(axis=0), (np.linalg.norm(x, axis=1) * np.linalg.norm(masses * v, axis=1)).sum()

        before, scale = turning()
        sim.step(300)
        assert np.abs(turning()[0] - before).max() < 0.01 * scale


# -- the contract ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_nothing_close_no_bit_changes(dtype):
    ends = []
    for scene in (CLOTH, COLLIDING):
        sim = Simulator(scene.replace(dtype=dtype))
        sim.set_wind(mean=(20 * MEAN_MASS, 3 * MEAN_MASS, 0))
        sim.step(400)
        ends.append((sim.positions, sim.velocities))
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("scene", [CLOTH, layered(CLOTH)])
def test_the_step_limit_stays(scene):
    assert max_timestep(scene.adding(SelfCollision())) == max_timestep(scene)
    assert SelfCollision().linear_bound(scene.lattice) == ((), None, None, False)


def test_the_rest_pose_is_free_of_contact_at_any_thickness():
    for thickness in (None, 0.01, 0.3, 5.0):
        scene = layered(CLOTH, drag=0.0).adding(SelfCollision(thickness)).replace(perturbation=0.0)
        sim = Simulator(scene)
        sim.step(20)
        np.testing.assert_allclose(sim.positions[0], scene.lattice.rest_positions, rtol=0, atol=1e-12)


def test_a_state_continues_to_the_bit():
    sim = Simulator(COLLIDING, copies=3)
    sim.set_positions(folded(CLOTH.lattice, 1.5 * max(CLOTH.lattice.spacings)))
    gale(sim)
    sim.step(333)
    state = sim.get_state()
    ends = []
    other = Simulator(COLLIDING, copies=3, threads=1)
    gale(other)
    other.step(101)  # its own lists are of other poses
    for run in (sim, other, other):
        run.set_state(state)
        run.step(200)
        ends.append((run.positions, run.velocities))
    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_array_equal(ends[0], ends[2])
    unbroken = Simulator(COLLIDING, copies=3)
    unbroken.set_positions(folded(CLOTH.lattice, 1.5 * max(CLOTH.lattice.spacings)))
    gale(unbroken)
    unbroken.step(533)
    np.testing.assert_array_equal((unbroken.positions, unbroken.velocities), ends[0])


def test_the_state_of_a_start_can_be_set():
    many, one = Simulator(COLLIDING, copies=2), Simulator(COLLIDING)
    start = one.get_state()
    for sim in (many, one):
        gale(sim)
        sim.step(100)
    end = one.positions[0]
    many.set_state(start, copies=[1])
    gale(many)
    many.step(100)
    np.testing.assert_array_equal(many.positions[1], end)


def test_one_copy_of_a_state_continues_in_any_place():
    many = Simulator(COLLIDING, copies=2)
    gale(many)
    many.step(200)
    one = Simulator(COLLIDING)
    gale(one)
    one.step(300)
    many.set_state(one.get_state(), copies=[1])
    for sim in (many, one):
        sim.step(100)
    np.testing.assert_array_equal(many.positions[1], one.positions[0])


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_copies_and_threads_give_the_same_bits(dtype):
    scene = COLLIDING.replace(dtype=dtype)
    x = np.stack([folded(CLOTH.lattice, gap * max(CLOTH.lattice.spacings)) for gap in (1.3, 1.5, 1.7, 2.0)])
    sims = [Simulator(scene, copies=4, threads=threads) for threads in (1, 2)]
    for sim in sims:
        sim.set_positions(x)
        sim.set_wind(mean=(0.0, -8 * MEAN_MASS, 0.0))
        sim.step(300)
    np.testing.assert_array_equal(sims[0].positions, sims[1].positions)
    for copy in range(4):
        alone = Simulator(scene.replace(perturbation=0.0))
        alone.set_positions(x[copy])
        alone.set_wind(mean=(0.0, -8 * MEAN_MASS, 0.0))
        alone.step(300)
        np.testing.assert_array_equal(alone.positions[0], sims[0].positions[copy])
    assert not np.array_equal(sims[0].positions[0], sims[0].positions[1])


def test_single_precision_stays_single():
    data = bound_to(SelfCollision(), CLOTH.lattice, "float32")
    for name, value in {**data._asdict(), **data.blocks._asdict(), "blocks": 0}.items():
        kind = np.asarray(value).dtype
        assert kind == np.float32 or np.issubdtype(kind, np.integer), name


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("scale", [0.0, 1e-30, 1e-18, 1e-10, 1e-3])
def test_coincident_particles_part(scale, dtype):
    scene = Scene(BEADS, (SelfCollision(0.05),), timestep=1e-3, dtype=dtype)
    sim = Simulator(scene)
    x = scale * np.random.default_rng(0).standard_normal((*BEADS.shape, 3))
    sim.set_positions(x)
    sim.step(200)
    assert np.isfinite(sim.positions).all()
    rest = pdist(BEADS.rest_positions.reshape(-1, 3))
    apart = pdist(sim.positions[0].reshape(-1, 3))
    linked = rest < 1.01 * np.hypot(0.1, 0.1)
    assert (apart[~linked] > 0.8 * 0.05).all()


def test_numbers_that_are_not_finite_stop_the_copy_only():
    sim = Simulator(CLOTH.adding(SelfCollision()).replace(timestep=0.02, allow_unstable=True), copies=2)
    x = np.stack([CLOTH.lattice.rest_positions, 1.5 * CLOTH.lattice.rest_positions])
    sim.set_positions(x)
    with pytest.raises(Diverged):
        sim.step(2000)
    for large in (1e30, 1e150, 1e300):  # finite, and beyond any cell
        sim = Simulator(Scene(BEADS, (SelfCollision(0.1),), timestep=1e-3))
        sim.set_positions(large * np.random.default_rng(1).standard_normal((*BEADS.shape, 3)))
        sim.step(3)
        assert np.isfinite(sim.positions).all()


def test_it_works_with_every_effect_of_a_flag_and_a_moving_mast():
    sim = Simulator(COLLIDING)
    gale(sim)
    for turn in range(40):
        sim.set_mast(position=(0.3 * np.sin(turn / 3), 0.3 * np.cos(turn / 5) - 0.3, 0.0), tilt=(0.3 * np.sin(turn / 4), 0.0))
        sim.step(40)
        assert crossings(sim.positions[0]) == 0


def test_an_effect_is_a_value():
    effect = SelfCollision(0.1, 0.2, 0.3)
    assert pickle.loads(pickle.dumps(effect)) == effect
    assert hash(effect) == hash(SelfCollision(0.1, 0.2, 0.3))
    assert SelfCollision().reach(CLOTH.lattice) == pytest.approx(1.2 * max(CLOTH.lattice.spacings[:2]))
    for wrong in ({"thickness": np.inf}, {"thickness": -1.0}, {"friction": -0.1}, {"restitution": 0.71}, {"restitution": -0.1}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            SelfCollision(**wrong)
    with pytest.raises(ValueError, match="dimensions"):
        presets.sheet().adding(effect)
    assert isinstance(COLLIDING.integrator, integrators.Leapfrog)
