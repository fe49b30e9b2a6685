"""The gusts' streams: by seed and copy alone, exact in a state, changed while they blow, and seeded anew."""

import math
import pickle

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator
from flag_env.physics.effects import AirPressure, CosineWind, Gusts, Structural
from tests.physics.scenes import leapfrog_scene
from tests.physics.test_gusts import GUSTS, MOTE, record


def test_streams_depend_on_seed_and_copy_alone():
    scene = Scene(Lattice(1, 3, 5, 0.1, 0.02), (Structural(100.0, 0.1), GUSTS), timestep=1e-3)
    many, one = Simulator(scene, copies=3, seed=5, threads=2), Simulator(scene, seed=5)
    other = Simulator(scene, seed=6)
    for sim in (many, one, other):
        sim.step(300)
    np.testing.assert_array_equal(many.positions[0], one.positions[0])
    assert not np.allclose(many.positions[0], many.positions[1], atol=1e-6)
    assert not np.allclose(one.positions, other.positions, atol=1e-6)
    a, b = (record(GUSTS, 50_000, 0.02, seed=seed) for seed in (0, 1))
    limit = 4 * math.sqrt(2 * np.max(GUSTS.scale) / GUSTS.speed / 1000)
    assert all(abs(np.corrcoef(a[:, i], b[:, i])[0, 1]) < limit for i in range(3))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_state_continues_to_the_bit(dtype):
    scene = Scene(Lattice(1, 3, 5, 0.1, 0.02), (Structural(100.0, 0.1), GUSTS), timestep=1e-3, dtype=dtype)
    sim = Simulator(scene, copies=2)
    sim.step(123)
    state = pickle.loads(pickle.dumps(sim.get_state()))
    sim.step(200)
    fresh = Simulator(scene, copies=2, seed=99)
    fresh.set_state(state)
    fresh.step(77)
    _ = fresh.velocities  # reading changes nothing
    fresh.step(123)
    np.testing.assert_array_equal(fresh.positions, sim.positions)
    fresh.set_state(state, copies=[1])
    assert not np.array_equal(fresh.positions[1], sim.positions[1])
    fresh.step(200)
    np.testing.assert_array_equal(fresh.positions[1], sim.positions[1])


def test_the_wind_can_be_changed_while_it_blows():
    scene = leapfrog_scene(MOTE, (Gusts(0.0, mean=(0.0, 0.0, 0.0), rate=2.0),), timestep=1e-3)
    sim = Simulator(scene, copies=2)
    sim.set_wind(mean=[[1.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    sim.step(100)
    np.testing.assert_allclose(sim.get_state().velocities[:, :, 0], [[0.2, 0, 0], [0, 0.6, 0]], rtol=1e-12)
    both = Simulator(scene.adding(CosineWind()))
    with pytest.raises(ValueError, match=r"winds in N and m/s"):
        both.set_wind(mean=(1.0, 0.0, 0.0))


TURBULENT = {
    "Gusts": Scene(Lattice(1, 3, 5, 0.1, 0.02), (Structural(100.0, 0.1), GUSTS), timestep=1e-3),
    "AirPressure": Scene(Lattice(1, 3, 5, 0.1, 0.02), (Structural(100.0, 0.1), AirPressure(gusts=GUSTS)), timestep=1e-3),
}


@pytest.mark.parametrize("name", TURBULENT)
def test_reseeded_copies_have_the_turbulence_of_fresh_simulators_with_these_seeds(name):
    """Whenever they start anew and wherever they stand, and the other copies go on as they were."""
    scene = TURBULENT[name]
    sim, untouched = (Simulator(scene, copies=3) for _ in range(2))
    for one in (sim, untouched):
        one.step(137)
    start = Simulator(scene).get_state()
    sim.set_state(start, copies=[2, 0])
    sim.reseed([2, 0], np.array([7, 2**70], object))
    sim.step(200)
    untouched.step(200)
    np.testing.assert_array_equal(sim.positions[1], untouched.positions[1])
    for copy, seed in ((2, 7), (0, 2**70)):
        single = Simulator(scene, seed=seed)
        single.step(200)
        np.testing.assert_array_equal(sim.positions[copy], single.positions[0])
        np.testing.assert_array_equal(sim.velocities[copy], single.velocities[0])
    assert not np.array_equal(sim.positions[0], sim.positions[2])


def test_reseeding_moves_nothing_but_the_air():
    sim = Simulator(TURBULENT["Gusts"], copies=2)
    sim.step(50)
    before = sim.positions, sim.time
    sim.reseed(range(2), [3, 3])
    assert np.array_equal(sim.positions, before[0])

    assert sim.time == before[1]
    turbulence = sim._run.effects[1].turbulence
    assert np.array_equal(turbulence.history[0], turbulence.history[1])


@pytest.mark.parametrize(
    ("copies", "seeds", "error", "name"),
    [
        ([2], [0], ValueError, "copies"),
        (0, [0], TypeError, "copies"),
        ([0], 5, TypeError, "seeds"),
        ([0], [-1], ValueError, "seeds"),
        ([0], [1.5], TypeError, "seeds"),
        ([0], [None], TypeError, "seeds"),
        ([0, 1], [1], ValueError, "seeds"),
    ],
)
def test_wrong_copies_and_seeds_are_refused_by_name_and_change_nothing(copies, seeds, error, name):
    sim = Simulator(TURBULENT["Gusts"], copies=2)
    before = sim.get_state()
    with pytest.raises(error, match=name):
        sim.reseed(copies, seeds)
    for a, b in zip(before.arrays(), sim.get_state().arrays(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_scene_without_turbulence_is_not_reseeded():
    with pytest.raises(ValueError, match=r"scene must hold turbulence for reseed, such as effects.Gusts\(\)"):
        Simulator(Scene(MOTE, (CosineWind(),), timestep=1e-3)).reseed([0], [1])
