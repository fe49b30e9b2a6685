"""Self-collision where cloth is fine, thick or fast, and where no list holds all pairs."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from flag_env.physics import Lattice, Scene, Simulator, presets
from flag_env.physics.effects import SelfCollision
from tests.physics.test_self_collision_crossings import crossings
from tests.physics.test_self_collision_laws import BEADS, crowd
from tests.physics.test_self_collision_pairs import bound_to, brute_pairs


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
