"""Divergence: one copy's bad number leaves the others alone, is refused in a state, caught where it arises, and can be healed."""

import dataclasses
import pickle

import numpy as np
import pytest

from flag_env.physics import Diverged, Simulator, integrators
from tests.physics.test_simulator_state import DTYPES, bits, same, windy


def test_one_diverging_copy_leaves_the_others_alone():
    scene = windy()
    sim, healthy = Simulator(scene, copies=3), Simulator(scene, copies=3)
    velocities = np.zeros((3, 1, 6, 7, 3))
    velocities[1, 0, 2, 3] = 1e308, -1e308, 1e308
    sim.set_velocities(velocities)
    with pytest.raises(Diverged) as caught:
        sim.step(120)
    healthy.step(120)
    assert caught.value.copy == 1
    assert 0 < caught.value.time <= 50 * sim.timestep
    assert sim.diverged.tolist() == [False, True, False]
    assert sim.time == healthy.time
    stopped = sim.get_state().positions[1].tobytes()
    sim.step(40)  # told once
    healthy.step(40)
    for copy in (0, 2):
        np.testing.assert_array_equal(sim.positions[copy], healthy.positions[copy])
        np.testing.assert_array_equal(sim.velocities[copy], healthy.velocities[copy])
    assert sim.get_state().positions[1].tobytes() == stopped

    sim.set_state(healthy.get_state(), copies=[1])
    for one in (sim, healthy):
        one.step(40)
    assert same(sim, healthy)


def test_placing_a_diverged_copy_anew_revives_it():
    sim, fresh = Simulator(windy()), Simulator(windy())
    sim.set_velocities(np.full((1, 6, 7, 3), 1e308) * (-1.0) ** np.arange(7)[:, None])
    with pytest.raises(Diverged):
        sim.step(100)
    with pytest.raises(Diverged):
        sim.step(1)
    sim.set_positions(fresh.positions)
    sim.set_velocities(fresh.velocities)
    sim.set_wind(amplitude=(0, 0, 0), mean=(0, 0, 0))
    fresh.set_wind(amplitude=(0, 0, 0), mean=(0, 0, 0))
    for one in (sim, fresh):
        one.step(50)
    np.testing.assert_array_equal(sim.positions, fresh.positions)


@pytest.mark.parametrize("order", [("positions", "velocities"), ("velocities", "positions")])
@pytest.mark.parametrize("integrator", [integrators.LFAB(), integrators.Leapfrog()], ids=["LFAB", "Leapfrog"])
def test_a_diverged_copy_runs_on_once_all_its_numbers_are_good(order, integrator):
    scene = windy().replace(integrator=integrator)
    sim, fresh = Simulator(scene, copies=2), Simulator(scene, copies=2)
    velocities = np.zeros((2, 1, 6, 7, 3))
    velocities[1] = 1e308 * (-1.0) ** np.arange(7)[:, None]
    sim.set_velocities(velocities)
    with pytest.raises(Diverged):
        sim.step(100)
    assert not np.isfinite(sim.get_state().positions[1]).all()
    assert not np.isfinite(sim.get_state().velocities[1]).all()
    for setter, name in zip((getattr(sim, f"set_{name}") for name in order), order, strict=True):
        assert sim.diverged.tolist() == [False, True]
        setter(getattr(fresh, name))
    assert sim.diverged.tolist() == [False, False]
    sim.set_wind(amplitude=(0, 0, 0), mean=(0, 0, 0))
    fresh.set_wind(amplitude=(0, 0, 0), mean=(0, 0, 0))
    for one in (sim, fresh):
        one.step(50)
    np.testing.assert_array_equal(sim.positions, fresh.positions)
    np.testing.assert_array_equal(sim.velocities, fresh.velocities)


@pytest.mark.parametrize("field", ["positions", "velocities"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", DTYPES)
def test_a_bad_number_in_a_state_is_refused_and_changes_nothing(field, bad, dtype):
    sim = Simulator(windy(dtype), copies=2)
    sim.step(3)
    state = sim.get_state()
    array = getattr(state, field).copy()
    array[1, 2, 23] = bad
    with pytest.raises(ValueError, match="state must be finite"):
        sim.set_state(dataclasses.replace(state, **{field: array}))
    for before, after in zip(state.arrays(), sim.get_state().arrays(), strict=True):
        np.testing.assert_array_equal(after, before)


@pytest.mark.parametrize("changed", [{"scales": (9.0, 1.0)}, {"scales": (np.nan, 1.0)}, {"time": np.inf}, {"time": np.nan}])
def test_a_state_that_does_not_fit_the_timestep_is_refused_and_changes_nothing(changed):
    sim = Simulator(windy())
    sim.step(3)
    state = sim.get_state()
    sim.step(4)
    before = bits(sim)
    with pytest.raises(ValueError, match=r"stiffness|state\.time"):
        sim.set_state(dataclasses.replace(state, **changed))
    assert bits(sim) == before


@pytest.mark.parametrize("field", ["x", "v"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", DTYPES)
def test_a_bad_number_that_arises_is_caught(field, bad, dtype):
    sim = Simulator(windy(dtype), copies=2)
    getattr(sim.run, field)[1, 2, 23] = bad
    with pytest.raises(Diverged) as caught:
        sim.step(1)
    assert caught.value.copy == 1
    assert caught.value.time == pytest.approx(sim.timestep)
    assert np.isfinite(sim.positions[0]).all()
    error = pickle.loads(pickle.dumps(caught.value))
    assert str(error) == str(caught.value)
