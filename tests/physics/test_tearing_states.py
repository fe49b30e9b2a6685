"""Tears are for good and for each copy alone, in states and copies too, and pieces keep their momentum."""

import pickle

import numpy as np
import pytest

from flag_env.physics import Simulator
from flag_env.physics.effects import Bending, Gravity, Shear, Structural, Tearing
from tests.physics.test_tearing import cloth, held, stormy, weights


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_storm_tears_more_and_more(dtype):
    sim = Simulator(stormy(dtype), copies=2)
    sim.set_wind(mean=[[0.02, 0.01, 0.0], [0.03, 0.015, 0.0]])
    before, counts = weights(sim), []
    for _ in range(60):
        sim.step(10)
        after = weights(sim)
        for name in weights(sim):
            assert not ((after[name] != 0) & (before[name] == 0)).any()  # nothing mends
            np.testing.assert_array_equal(after[name][after[name] != 0], before[name][after[name] != 0])
        before = after
        counts.append(held(sim))
        assert np.isfinite(sim.positions).all()
    assert (counts[-1] < counts[0] - 10).all()
    assert len({int(count[0]) for count in counts}) > 3  # link by link


def test_one_copys_tear_touches_no_other():
    winds = np.array([[0.01, 0.005, 0.0], [0.02, 0.01, 0.0], [0.03, 0.015, 0.0]])
    many = Simulator(stormy(), copies=3)
    many.set_wind(mean=winds)
    many.step(300)
    assert len(set(held(many))) == 3
    for copy in range(3):
        one = Simulator(stormy())
        one.set_wind(mean=winds[copy])
        one.step(300)
        np.testing.assert_array_equal(one.positions[0], many.positions[copy])
        for name in weights(one):
            np.testing.assert_array_equal(weights(one)[name][0], weights(many)[name][copy])


def test_a_state_brings_links_back_and_takes_them_away():
    sim = Simulator(stormy(), copies=2)
    fresh = sim.get_state()
    sim.set_wind(mean=(0.03, 0.015, 0.0))
    sim.step(360)
    torn = pickle.loads(pickle.dumps(sim.get_state()))
    assert (held(sim) < held(Simulator(stormy()))).all()
    sim.step(200)
    end, links = sim.positions, held(sim)
    other = Simulator(stormy(), copies=2, seed=5)
    whole = held(other)
    other.set_state(torn)
    other.step(200)
    np.testing.assert_array_equal(other.positions, end)
    np.testing.assert_array_equal(held(other), links)
    other.set_state(fresh)
    np.testing.assert_array_equal(held(other), whole)
    other.set_wind(mean=(0.03, 0.015, 0.0))
    other.step(560)
    np.testing.assert_array_equal(other.positions, end)
    other.set_state(fresh, copies=[1])
    np.testing.assert_array_equal(held(other), [links[0], whole[1]])


def test_a_copied_simulator_tears_alone():
    sim = Simulator(stormy())
    sim.set_wind(mean=(0.02, 0.01, 0.0))
    sim.step(360)
    twin = pickle.loads(pickle.dumps(sim))
    links = held(sim)
    twin.step(300)
    np.testing.assert_array_equal(held(sim), links)
    sim.step(300)
    np.testing.assert_array_equal(sim.positions, twin.positions)
    assert held(sim) < links


def test_new_parameters_mend_nothing():
    sim = Simulator(stormy(), copies=2)
    sim.set_wind(mean=[[0.02, 0.01, 0.0], [0.03, 0.015, 0.0]])
    sim.step(360)
    links = weights(sim)
    for scales in ((0.5, 1.0), (0.5, 0.0), (1.0, 1.0)):
        sim.set_parameters(*scales)
        for name in weights(sim):
            np.testing.assert_array_equal(weights(sim)[name], links[name])
        for effect, data in zip(sim.scene.effects, sim.run.effects, strict=True):
            if isinstance(effect, (Structural, Shear, Bending)):
                np.testing.assert_array_equal(data.weight, links[type(effect).__name__.lower()])
    twin = Simulator(stormy(), copies=2)
    twin.set_state(sim.get_state())
    for each in (sim, twin):
        each.step(200)
    np.testing.assert_array_equal(sim.positions, twin.positions)
    assert (held(sim) < sum((weight != 0).sum(axis=(1, 2)) for weight in links.values())).any()


@pytest.mark.parametrize("layers", [1, 2])
def test_pieces_keep_the_momentum_they_had(layers):
    """Pulled apart without outer forces: total momentum, and that of every piece once it flies alone."""
    scene = cloth(Tearing(0.2), pinned="none", layers=layers).without(Gravity)
    sim = Simulator(scene)
    v = np.random.default_rng(0).normal(0, 0.1, (*scene.lattice.shape, 3))
    v[:, :, 4:, 0] += 6.0
    sim.set_velocities(v)
    masses = scene.lattice.masses.reshape(*scene.lattice.shape, 1)
    total = (masses * v).sum(axis=(0, 1, 2))
    sim.advance(0.15)
    pieces = []
    for _ in range(2):
        p = masses * sim.velocities[0]
        np.testing.assert_allclose(p.sum(axis=(0, 1, 2)), total, rtol=0, atol=1e-13)
        pieces.append(np.stack([p[:, :, :2].sum(axis=(0, 1, 2)), p[:, :, 6:].sum(axis=(0, 1, 2))]))
        sim.advance(0.3)
    right = sim.positions[0, :, :, 4:, 0].min()
    left = sim.positions[0, :, :, :4, 0].max()
    assert held(sim) < held(Simulator(scene))
    assert right > left or np.abs(pieces[1] - pieces[0]).max() < np.abs(pieces[0]).max()
