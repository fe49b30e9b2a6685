"""Every integrator keeps the simulator's contract: exact states, independent copies, divergence, precisions, bad arguments."""

import dataclasses
import pickle

import numpy as np
import pytest

from flag_env.physics import Diverged, Lattice, Scene, Simulator, presets
from flag_env.physics.effects import CosineWind, Gravity
from flag_env.physics.integrators import Implicit, Integrator, Leapfrog, Strang
from flag_env.physics.limits.spectrum import SceneSpectrum
from tests.physics.test_integrators_order import MAST, beginning, every_method, smooth


def bits(sim):
    state = sim.get_state()
    arrays = [state.positions, state.velocities, state.history, sim.positions, sim.velocities, *sim.energy().values()]
    return (sim.time, *(np.ascontiguousarray(array).tobytes() for array in arrays))


def shaken(method, dtype="float64", copies=1, **options):
    scene = smooth("isotropic", method, dtype=dtype, timestep=1e-3)
    sim = Simulator(scene, copies=copies, **options)
    x, v = beginning(scene)
    scale = 1 + 0.1 * np.arange(copies)[:, None, None, None, None]
    sim.set_positions(np.broadcast_to(x, (copies, *x.shape)))
    sim.set_velocities(scale * v)
    sim.set_wind(amplitude=0.05 * np.arange(3.0 * copies).reshape(copies, 3) / copies)
    return sim


@every_method
def test_copies_threads_and_groups_of_steps_do_not_change_a_bit(method):
    sims = [shaken(method, copies=5, threads=threads) for threads in (1, 2)]
    for sim in sims:
        sim.set_mast(MAST)
        sim.step(400)
        sim.step(40)
    assert 5 * 12 * 400 > 20_000  # enough to wake threads
    assert bits(sims[0]) == bits(sims[1])
    for copy in (0, 3):
        single = shaken(method)
        many = shaken(method, copies=5)
        single.set_velocities(many.velocities[copy])
        single.set_wind(amplitude=0.05 * np.arange(15.0).reshape(5, 3)[copy] / 5)
        single.set_mast(MAST)
        single.step(400)
        for n in (1, 19, 20):
            single.step(n)
        np.testing.assert_array_equal(single.positions[0], sims[0].positions[copy])
        np.testing.assert_array_equal(single.velocities[0], sims[0].velocities[copy])


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@every_method
def test_a_state_holds_all_that_a_method_remembers(method, dtype):
    sim = shaken(method, dtype, copies=2)
    sim.step(20)
    state = pickle.loads(pickle.dumps(sim.get_state()))
    assert {array.dtype for array in (state.positions, state.velocities, state.history)} == {np.dtype(dtype)}
    other = shaken(method, dtype, copies=2)
    other.step(7)
    other.set_state(state)
    assert bits(other) == bits(sim)
    copied = pickle.loads(pickle.dumps(sim))
    for one in (sim, other, copied):
        one.step(30)
    assert bits(other) == bits(sim) == bits(copied)
    some = shaken(method, dtype, copies=2)
    some.step(50)
    some.set_state(state, copies=[1])
    some.step(30)
    np.testing.assert_array_equal(some.positions[1], sim.positions[1])
    with pytest.raises(ValueError, match="same scene"):
        sim.set_state(dataclasses.replace(state, history=np.zeros((2, 3, 3, 12), dtype)))


@every_method
def test_velocities_set_anew_leave_nothing_of_the_past(method):
    sim, fresh = shaken(method), shaken(method)
    x, v = fresh.positions, fresh.velocities
    sim.step(33)
    sim.set_state(dataclasses.replace(fresh.get_state(), history=sim.get_state().history))
    sim.set_positions(x)
    sim.set_velocities(v)
    np.testing.assert_array_equal(sim.velocities, v)
    for one in (sim, fresh):
        one.step(40)
    assert bits(sim) == bits(fresh)


@every_method
def test_parameters_scaled_while_running(method):
    sim = shaken(method)
    sim.step(10)
    scene = sim.scene.scaled(0.5, 0.8)
    other = Simulator(scene)
    other.set_state(dataclasses.replace(sim.get_state(), scene=scene))
    sim.set_parameters(0.5, 0.8)
    for one in (sim, other):
        one.step(30)
    assert bits(sim) == bits(other)


@every_method
def test_divergence_is_told_and_healed(method):
    sim, healthy = shaken(method, copies=2), shaken(method, copies=2)
    velocities = sim.velocities
    velocities[1, 0, 1, 2], velocities[1, 0, 1, 3] = 1.7e308, -1.7e308
    sim.set_velocities(velocities)
    with pytest.raises(Diverged) as caught:
        sim.step(120)
    healthy.step(120)
    assert caught.value.copy == 1
    np.testing.assert_array_equal(sim.positions[0], healthy.positions[0])
    np.testing.assert_array_equal(sim.velocities[0], healthy.velocities[0])
    sim.set_state(healthy.get_state(), copies=[1])
    for one in (sim, healthy):
        one.step(40)
    assert bits(sim) == bits(healthy)


@every_method
def test_single_precision_in_the_plane_agrees_with_double_in_space(method):
    scene = smooth("isotropic", method).without(CosineWind)
    flat = scene.replace(lattice=dataclasses.replace(scene.lattice, dimensions=2), dtype="float32")
    x, v = beginning(scene)
    x[..., 1] = v[..., 1] = 0.0
    ends = []
    for one in (scene, flat):
        sim = Simulator(one)
        sim.set_positions(x)
        sim.set_velocities(v)
        sim.step(200)
        ends.append(np.stack([sim.positions, sim.velocities]))
    assert np.abs(ends[0][0] - x).max() > 0.05
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=2e-5)


@every_method
def test_a_method_is_a_value(method):
    assert pickle.loads(pickle.dumps(method)) == method
    assert hash(dataclasses.replace(method)) == hash(method)
    with pytest.raises(dataclasses.FrozenInstanceError):
        method.something = 1
    rope = presets.rope(8, integrator=method, timestep="auto")
    data = method.bind(np.dtype("float32"), 1e-3, SceneSpectrum(rope.lattice, rope.effects))
    kept = {"seconds", "iterations", "factor"}
    assert {np.asarray(value).dtype for name, value in data._asdict().items() if name not in kept} == {np.dtype("float32")}
    if hasattr(data, "factor"):
        assert {array.dtype for array in data.factor[1:]} == {np.dtype("float32")}


@every_method
def test_scenes_without_free_particles_or_links(method):
    for lattice in (Lattice(1, 1, 1), Lattice(1, 2, 2, pinned="sleeve"), Lattice(1, 1, 3, pinned="none", dimensions=1)):
        sim = Simulator(Scene(lattice, (Gravity(8.0),), method, timestep=0.125))
        sim.step(4)
        fallen = np.where(lattice.fixed, 0.0, (sim.positions[0] - lattice.rest_positions)[..., 2].ravel())
        assert fallen[~lattice.fixed] == pytest.approx(-1.0, abs=0.6)


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match="start must be one of 'report', 'half_kick', got 'late'"):
        Leapfrog("late")
    for kind in (Strang, Implicit):
        with pytest.raises(ValueError, match="iterations must be at least 1, got 0"):
            kind(0)
    for name in ("limit", "useful"):
        with pytest.raises(NotImplementedError, match="limit"):
            getattr(Integrator(), name)(None)
    with pytest.raises(NotImplementedError, match="bind"):
        Integrator().bind(None, 1.0, None)
