"""The simulator's state: arrays are shaped as promised, what is set is read, and a state continues to the bit."""

import pickle

import numpy as np
import pytest

from flag_env.physics import Simulator, presets
from flag_env.physics.effects import CosineWind

DTYPES = ("float64", "float32")


def windy(dtype="float64", **changes):
    wind = CosineWind((0.02, 0.03, 0.01), (3.0, 7.0, 5.0), (0.01, 0.0, 0.0), (0.1, 0.2, 0.3))
    return presets.flag(6, 7, dtype=dtype, **changes).adding(wind)


def bits(sim):
    """Everything a simulator shows of itself, as bytes."""
    state = sim.get_state()
    arrays = [state.positions, state.velocities, state.mast_targets, state.stepped, *(a for rest in state.effects for a in rest)]
    arrays += [sim.positions, sim.velocities, *sim.energy().values()]
    return (sim.time, *(np.ascontiguousarray(array).tobytes() for array in arrays))


def same(a, b):
    return bits(a) == bits(b)


@pytest.mark.parametrize("dtype", DTYPES)
def test_arrays_are_fresh_and_shaped_as_promised(dtype):
    scene = windy(dtype, pinned="sleeve")
    sim = Simulator(scene, copies=3)
    sim.step(2)
    for name in ("positions", "velocities"):
        value = getattr(sim, name)
        assert value.shape == (3, 1, 6, 7, 3)
        assert value.dtype == np.float64
        assert value.flags.c_contiguous
        kept = value.copy()
        value[:] = 7.0
        np.testing.assert_array_equal(getattr(sim, name), kept)
    assert all(value.shape == (3,) for value in sim.energy().values())
    assert set(sim.energy()) == {"kinetic", "gravity", "structural", "shear", "bending"}
    assert (sim.copies, sim.scene) == (3, scene)
    assert sim.time == 2 * sim.timestep


def test_a_fresh_simulator_is_at_rest_but_for_its_seeded_perturbation():
    scene = windy(perturbation=1e-4)
    sim = Simulator(scene, copies=50, seed=4)
    assert not sim.velocities.any()
    noise = sim.positions - scene.lattice.rest_positions
    assert not noise[..., [0, 2]].any()
    assert not noise[..., 0, :].any()
    assert noise[..., 1:, 1].std() == pytest.approx(1e-4, rel=0.05)
    assert len(np.unique(noise[..., 1:, 1])) == 50 * 6 * 6
    assert same(sim, Simulator(scene, copies=50, seed=4))
    assert not np.array_equal(sim.positions, Simulator(scene, copies=50, seed=5).positions)
    np.testing.assert_array_equal(Simulator(scene, copies=2, seed=4).positions, sim.positions[:2])
    assert np.array_equal(Simulator(scene.replace(perturbation=0.0)).positions[0], scene.lattice.rest_positions)


def test_velocities_are_at_the_instant_of_the_positions():
    sim = Simulator(windy())
    sim.step(200)
    x, v = [], []
    for _ in range(3):
        x.append(sim.positions)
        v.append(sim.velocities)
        sim.step(1)
    central = (x[2] - x[0]) / (2 * sim.timestep)
    np.testing.assert_allclose(v[1], central, rtol=0, atol=1e-11 * np.abs(central).max())


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("leading", [False, True])
def test_what_is_set_is_what_is_read(dtype, leading):
    sim = Simulator(windy(dtype), copies=3)
    sim.step(3)
    random = np.random.default_rng(0)
    shape = (3, 1, 6, 7, 3) if leading else (1, 6, 7, 3)
    x, v = (random.standard_normal(shape).astype(dtype).astype(float) for _ in range(2))
    sim.set_positions(x)
    sim.set_velocities(v)
    np.testing.assert_array_equal(sim.positions, np.broadcast_to(x, (3, 1, 6, 7, 3)))
    np.testing.assert_array_equal(sim.velocities, np.broadcast_to(v, (3, 1, 6, 7, 3)))
    sim.step(4)
    np.testing.assert_array_equal(sim.positions[:, :, :, 0], np.broadcast_to(x[..., 0, :], (3, 1, 6, 3)))  # pinned where put


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_state_continues_to_the_bit(dtype):
    sim = Simulator(windy(dtype), copies=3)
    sim.step(20)
    sim.set_wind(frequency=np.arange(9.0).reshape(3, 3))
    sim.set_mast((0.01, 0.02, 0.03))
    state = sim.get_state()
    thawed = pickle.loads(pickle.dumps(state))
    sim.step(30)
    other = Simulator(windy(dtype), copies=3, seed=9)
    other.step(7)
    for given in (state, thawed):
        other.set_state(given)
        assert other.time == 20 * sim.timestep
        other.step(30)
        assert same(sim, other)


def test_a_state_may_be_set_for_some_copies_and_from_one():
    scene = windy()
    sim, other = Simulator(scene, copies=3), Simulator(scene, copies=3, seed=1)
    sim.step(20)
    other.step(5)
    untouched = other.positions
    other.set_state(sim.get_state(), copies=[1])
    assert other.time == 5 * sim.timestep
    np.testing.assert_array_equal(other.positions, np.stack([untouched[0], sim.positions[1], untouched[2]]))
    sim.step(10)
    other.step(10)
    np.testing.assert_array_equal(other.positions[1], sim.positions[1])
    np.testing.assert_array_equal(other.velocities[1], sim.velocities[1])

    single = Simulator(scene, seed=3)
    single.step(12)
    other.set_state(single.get_state(), copies=(0, 2))
    other.step(4)
    single.step(4)
    for copy in (0, 2):
        np.testing.assert_array_equal(other.positions[copy], single.positions[0])


def test_a_pickled_simulator_goes_on_to_the_bit():
    sim = Simulator(windy(), copies=8, threads=2)
    sim.step(200)  # has woken its threads
    sim.set_parameters(0.5, 0.5)
    other = pickle.loads(pickle.dumps(sim))
    for one in (sim, other):
        one.step(30)
    assert same(sim, other)
