"""Self-collision keeps the simulator's contract: exact states, independent copies, its step limit, its values."""

import pickle

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from flag_env.physics import Diverged, Scene, Simulator, max_timestep, presets
from flag_env.physics.effects import SelfCollision
from tests.physics.test_self_collision_crossings import CLOTH, COLLIDING, MEAN_MASS, crossings, folded, gale, layered
from tests.physics.test_self_collision_laws import BEADS
from tests.physics.test_self_collision_pairs import bound_to


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
