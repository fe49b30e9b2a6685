"""Checks the simulator's contract: shapes, exact states, independent copies, controls, divergence and refused arguments."""

import dataclasses
import pickle
from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flag_env.physics import Diverged, Lattice, Scene, Simulator, State, effects, integrators, max_timestep, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, Shear, Structural
from flag_env.physics.integrators import Leapfrog

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


# -- state -------------------------------------------------------------------------------------------------------------------


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


# -- running -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
def test_steps_add_up_to_the_bit(dtype):
    a, b = Simulator(windy(dtype)), Simulator(windy(dtype))
    a.step(500)
    for n in (200, 0, 250, 50):
        b.step(n)
    assert same(a, b)


def test_advance_takes_whole_steps_and_keeps_the_remainder():
    sim = Simulator(windy(timestep=1e-3))
    for seconds, steps in ((0.01, 10), (0.0104, 10), (0.0106, 11), (0.0004, 0), (0.0, 0), (0.0004, 1), (0.0003, 0), (0.0, 0)):
        before = sim.time
        sim.advance(seconds)
        assert round((sim.time - before) / sim.timestep) == steps


@pytest.mark.parametrize(("calls", "seconds", "timestep"), [(300, 0.0333, 1e-3), (4000, 0.0005, 1e-3), (4000, 0.0005, 7.7e-4)])
def test_many_short_advances_are_one_long_one(calls, seconds, timestep):
    sim, once = (Simulator(Scene(Lattice(1, 1, 1), (Gravity(),), timestep=timestep)) for _ in range(2))
    for call in range(1, calls + 1):
        sim.advance(seconds)
        assert abs(sim.time - call * seconds) <= (0.5 + 1e-9) * timestep
    once.advance(calls * seconds)
    assert sim.time == pytest.approx(calls * seconds, abs=0.51 * timestep)
    assert same(sim, once)


def test_the_remainder_lives_on_through_steps_states_pickles_and_refusals():
    """The sum of what was asked for, in exact fractions, and the simulated time are never more than half a step apart."""
    sim, random = Simulator(windy(timestep=1e-3)), np.random.default_rng(5)
    asked, kept = Fraction(0), None
    for _ in range(600):
        match random.integers(6):
            case 0:
                n = int(random.integers(3))
                sim.step(n)
                asked += n * Fraction(sim.timestep)
            case 1 if kept is not None:
                sim.set_state(kept[0])
                asked = kept[1]
            case 2:
                kept = sim.get_state(), asked
            case 3:
                sim = pickle.loads(pickle.dumps(sim))
            case 4:
                with pytest.raises(ValueError, match="seconds"):
                    sim.advance(-1.0)
            case _:
                seconds = float(random.choice([0.0, 1e-4, 3.3e-4, 5e-4, 1.6e-3]))
                sim.advance(seconds)
                asked += Fraction(seconds)
        assert abs(Fraction(sim.time) - asked) <= Fraction(0.5 + 1e-9) * Fraction(sim.timestep)
    assert asked > Fraction(1, 20)


def test_a_divergence_loses_no_time():
    sim = Simulator(windy(timestep=1e-3), copies=2)
    velocities = np.zeros((2, 1, 6, 7, 3))
    velocities[1, 0, 2, 3] = 1e308, -1e308, 1e308
    sim.set_velocities(velocities)
    with pytest.raises(Diverged):
        sim.advance(0.0104)
    for _ in range(10):
        sim.advance(0.0104)
    assert abs(sim.time - 11 * 0.0104) <= 0.501e-3


@pytest.mark.parametrize("dtype", DTYPES)
def test_copies_do_not_know_of_each_other_nor_of_threads(dtype):
    scene = windy(dtype)
    sims = [Simulator(scene, copies=5, seed=3, threads=threads) for threads in (1, 2)]
    amplitude = 0.03 * np.arange(15.0).reshape(5, 3)
    mast = 0.1 * np.random.default_rng(0).standard_normal((5, 3))
    for sim in sims:
        sim.set_wind(amplitude=amplitude)
        sim.set_mast(mast, yaw=0.1 * np.arange(5))
        sim.step(300)
    assert 5 * 42 * 300 > 20_000  # enough work to wake threads
    assert same(*sims)
    for copy in range(5):
        single = Simulator(scene)
        single.set_positions(Simulator(scene, copies=5, seed=3).positions[copy])
        single.set_wind(amplitude=amplitude[copy])
        single.set_mast(mast[copy], yaw=0.1 * copy)
        single.step(300)
        np.testing.assert_array_equal(single.positions[0], sims[0].positions[copy])
        np.testing.assert_array_equal(single.velocities[0], sims[0].velocities[copy])


@pytest.mark.parametrize("threads", [1, 2])
def test_each_block_of_copies_is_reported_once_it_has_been_read(threads):
    sim, plain = (Simulator(windy(), copies=5, seed=3, threads=threads) for _ in range(2))
    frame, seen = sim.frame(), {}

    def then(first, last):
        for copy in range(first, last):
            assert copy not in seen
            seen[copy] = frame.positions[copy].copy(), frame.velocities[copy].copy()

    assert sim.step_into(300, frame, then) == 5
    plain.step(300)
    assert sorted(seen) == [0, 1, 2, 3, 4]
    for copy, (positions, velocities) in seen.items():
        np.testing.assert_array_equal(positions, plain.positions[copy])
        np.testing.assert_array_equal(velocities, plain.velocities[copy])
    with pytest.raises(ZeroDivisionError):  # in whichever thread
        sim.step_into(300, frame, lambda first, last: 1 // (first - first))


@pytest.mark.linux
def test_forking_and_spawning_after_threads_ran(run_python, tmp_path):
    (tmp_path / "worker.py").write_text("def work(sim):\n    sim.step(300)\n    return sim.positions\n")
    script = """
import multiprocessing
import numpy as np
from flag_env.physics import Simulator, presets
from worker import work

if __name__ == "__main__":
    sim = Simulator(presets.flag(6, 7), copies=4, threads=2)
    sim.step(300)
    start = sim.get_state()
    here = work(sim)
    sim.set_state(start)
    for method in ("fork", "spawn"):
        with multiprocessing.get_context(method).Pool(1) as pool:
            there = pool.apply_async(work, (sim,)).get(timeout=200)
        assert np.array_equal(here, there), method
    child = multiprocessing.get_context("fork").Process(target=work, args=(sim,))
    child.start()
    child.join(200)
    print(child.exitcode, sim.time == start.time)
"""
    assert run_python(script, tmp_path).split() == ["0", "True"]


# -- controls ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pinned", ["edge", "sleeve"])
@pytest.mark.parametrize("dtype", DTYPES)
def test_mast_arrives_at_the_pose_asked_for(pinned, dtype):
    sim = Simulator(windy(dtype, pinned=pinned))
    fixed = sim.scene.lattice.fixed
    x, y, z = sim.scene.lattice.rest_positions.reshape(-1, 3)[fixed].T
    a = 0.3
    c, s = np.cos(a), np.sin(a)
    poses = [
        ({"position": (0.1, -0.2, 0.3)}, (x + 0.1, y - 0.2, z + 0.3)),
        ({"tilt": (a, 0.0)}, (x, c * y - s * z, s * y + c * z)),
        ({"tilt": (0.0, a)}, (c * x + s * z, y, -s * x + c * z)),
        ({"yaw": a}, (c * x - s * y, s * x + c * y, z)),
    ]
    turn = Rotation.from_euler("zxy", [0.5, -0.2, 0.4])  # about the fixed axes: yaw, then x, then y
    turned = turn.apply(np.stack([x, y, z], axis=1))
    turned += (1, 2, 3)
    poses.append(({"position": (1, 2, 3), "tilt": (-0.2, 0.4), "yaw": 0.5}, turned.T))
    for pose, expected in poses:
        sim.set_mast(**pose)
        sim.step(50)
        found = sim.positions[0].reshape(-1, 3)[fixed]
        np.testing.assert_allclose(found, np.transpose(expected), rtol=0, atol=1e-15 if dtype == "float64" else 3e-7)


def test_mast_moves_evenly():
    sim, by_hand = Simulator(windy()), Simulator(windy())
    sim.set_mast((0.1, 0.2, -0.1))
    sim.step(50)
    np.testing.assert_allclose(
        sim.velocities[0, :, :, 0], np.broadcast_to(np.array([0.1, 0.2, -0.1]) / sim.time, (1, 6, 3)), rtol=1e-13
    )
    for n in range(1, 51):
        by_hand.set_mast(np.array([0.1, 0.2, -0.1]) * n / 50)
        by_hand.step(1)
    np.testing.assert_allclose(sim.positions, by_hand.positions, rtol=0, atol=1e-13)
    sim.step(1)
    assert not sim.velocities[0, :, :, 0].any()


def test_yaw_turns_a_sleeve_and_does_nothing_to_an_edge():
    for pinned, turns in (("edge", False), ("sleeve", True)):
        still, yawed = Simulator(windy(pinned=pinned)), Simulator(windy(pinned=pinned))
        yawed.set_mast(yaw=0.4)
        for sim in (still, yawed):
            sim.advance(0.3)
        moved = np.abs(still.positions - yawed.positions).max()
        assert moved > 0.05 if turns else moved == 0.0


def test_mast_poses_may_differ_between_copies():
    sim = Simulator(windy(), copies=2)
    sim.set_mast([[0, 0, 0], [0.1, 0.2, 0.3]], tilt=(0, 0), yaw=[0.0, 1.0])
    sim.step(40)
    np.testing.assert_allclose(
        sim.positions[1, 0, :, 0] - sim.positions[0, 0, :, 0], np.tile([0.1, 0.2, 0.3], (6, 1)), atol=1e-15
    )


@pytest.mark.parametrize("pose", [{"position": (0.0, 0.1, 0.0)}, {"tilt": (0.1, 0.0)}, {"yaw": 0.2}])
def test_a_mast_stays_in_the_plane_of_a_sheet(pose):
    sim = Simulator(presets.sheet(4, 5, pinned="sleeve"))
    with pytest.raises(ValueError, match="position, tilt and yaw must keep y as at rest: the scene has dimensions=2"):
        sim.set_mast(**pose)
    assert not sim.velocities.any()
    sim.set_mast(position=(0.1, 0.0, -0.2), tilt=(0.0, 0.3))
    sim.step(20)
    np.testing.assert_allclose(sim.positions[0, 0, 0, 0], (0.1, 0.0, -0.2), atol=1e-15)


def test_wind_phase_goes_on_when_its_frequency_changes():
    m, h = 0.5, 1e-3
    wind = CosineWind((3.0, 2.0, 1.0), (4.0, 9.0, 20.0), (0.1, 0.2, -0.3), (0.3, 0.0, -1.0))
    sim = Simulator(Scene(Lattice(1, 1, 1, 0.1, m, pinned="none"), (wind,), timestep=h), copies=2)
    old, new = np.array([4.0, 9.0, 20.0]), np.array([[30.0, 1.0, 0.0], [2.0, 50.0, 7.0]])
    sim.step(300)
    sim.set_wind(frequency=new)
    sim.step(500)
    n = np.arange(800)[:, None, None]
    phase = np.array([0.3, 0.0, -1.0]) + h * (old * np.minimum(n, 300) + new * np.maximum(n - 300, 0))
    force = np.array([0.1, 0.2, -0.3]) + np.array([3.0, 2.0, 1.0]) * np.cos(phase)
    velocity = np.cumsum(h * force / m, axis=0)
    np.testing.assert_allclose(sim.positions[:, 0, 0, 0], h * velocity.sum(axis=0), rtol=1e-11)
    jump = np.array([0.3, 0.0, -1.0]) + new * 300 * h  # what the phase would be had it jumped
    assert np.abs(np.cos(jump) - np.cos(phase[300])).max() > 0.1


def test_wind_may_change_in_strength_and_mean_for_each_copy():
    scene = Scene(Lattice(1, 1, 1, 0.1, 0.5, pinned="none"), (CosineWind((1.0, 1.0, 1.0)),), timestep=1e-3)
    sim = Simulator(scene, copies=2)
    sim.set_wind(amplitude=[[1, 2, 3], [4, 5, 6]], mean=(1, 0, -1))
    sim.step(10)
    total = np.array([[2, 2, 2], [5, 5, 5]])
    np.testing.assert_allclose(sim.positions[:, 0, 0, 0], total / 0.5 * 1e-6 * 55, rtol=1e-13)


@pytest.mark.parametrize("dtype", DTYPES)
def test_scaling_parameters_is_simulating_the_scaled_scene(dtype):
    scene = windy(dtype)
    sim = Simulator(scene)
    sim.step(100)
    scaled = Simulator(scene.scaled(0.5, 0.25).replace(timestep=sim.timestep))
    scaled.set_state(dataclasses.replace(sim.get_state(), scene=scaled.scene))
    sim.set_parameters(0.7, 0.0)
    sim.set_parameters(0.5, 0.25)
    for one in (sim, scaled):
        one.step(200)
    assert same(sim, scaled)
    back = Simulator(scene)
    back.set_state(sim.get_state())
    for one in (sim, back):
        one.step(100)
    assert same(sim, back)
    for one in (sim, back):
        one.set_parameters()
        one.step(100)
    assert same(sim, back)


def test_scaling_beyond_the_limit_is_refused():
    sim = Simulator(windy())
    sim.step(10)
    before = bits(sim)
    limit = max_timestep(sim.scene.scaled(9.0))
    with pytest.raises(ValueError, match=r"stiffness_scale = 9 .*viscosity_scale = 1 ") as caught:
        sim.set_parameters(stiffness_scale=9.0)
    assert f"{limit:.6g}" in str(caught.value)
    assert f"{sim.timestep:.6g}" in str(caught.value)
    assert bits(sim) == before
    unsafe = Simulator(windy(allow_unstable=True))
    unsafe.set_parameters(stiffness_scale=9.0)


# -- divergence --------------------------------------------------------------------------------------------------------------


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


# -- refused arguments -------------------------------------------------------------------------------------------------------

NOT_WHOLE = [(2.5, TypeError), ("3", TypeError), (True, TypeError), (None, TypeError)]
NOT_COUNT = [*NOT_WHOLE, (0, ValueError), (-1, ValueError)]
NOT_NUMBER = [
    ("1", TypeError),
    (True, TypeError),
    (None, TypeError),
    ([1.0], TypeError),
    (np.nan, ValueError),
    (np.inf, ValueError),
]
NOT_SIZE = [*NOT_NUMBER, (-1.0, ValueError)]
NOT_POSITIVE = [*NOT_SIZE, (0.0, ValueError)]
NOT_VECTOR = [
    ("abc", TypeError),
    (1.0, ValueError),
    ((1.0, 2.0), ValueError),
    ((1.0, np.nan, 0.0), ValueError),
    ((0.0, 0.0, np.inf), ValueError),
    ((1.0, (2.0, 3.0), 4.0), TypeError),
]
NOT_BOOL = [("yes", TypeError), (1, TypeError), (None, TypeError)]
LATTICE = Lattice(1, 2, 3)


def table(make, **arguments):
    return [(make, name, value, error) for name, cases in arguments.items() for value, error in cases]


CONSTRUCTORS = [
    *table(Lattice, layers=NOT_COUNT, rows=NOT_COUNT, cols=NOT_COUNT, mass=NOT_POSITIVE, taper=NOT_POSITIVE),
    *table(Lattice, spacing=[*(c for c in NOT_POSITIVE if c[0] != [1.0]), ((1.0,), ValueError), ((1.0, 0.0), ValueError)]),
    *table(
        Lattice, pinned=[("top", ValueError), ((1, 640), ValueError), ((-1,), ValueError), ((0.5,), TypeError), (3, TypeError)]
    ),
    *table(
        lambda **one: Scene(**{"lattice": LATTICE, **one}),
        lattice=[(None, TypeError), ("flag", TypeError)],
        effects=[((1,), TypeError), ((Gravity,), TypeError), ((Gravity(), Gravity(1.0)), ValueError), (3, TypeError)],
        integrator=[(Leapfrog, TypeError), ("Leapfrog", TypeError), (None, TypeError)],
        timestep=[(0.0, ValueError), (-1.0, ValueError), (np.nan, ValueError), ("fast", ValueError), (None, TypeError)],
        dtype=[("float16", ValueError), ("int64", ValueError), ("double double", ValueError)],
        allow_unstable=NOT_BOOL,
        perturbation=NOT_SIZE,
    ),
    *table(Gravity, acceleration=NOT_NUMBER, tapered=NOT_BOOL),
    *table(AirDrag, rate=NOT_SIZE),
    *table(CosineWind, amplitude=NOT_VECTOR, frequency=NOT_VECTOR, mean=NOT_VECTOR, phase=NOT_VECTOR),
    *(
        case
        for kind in (Structural, Shear, Bending, CrossLayer)
        for case in table(
            kind, stiffness=NOT_SIZE, viscosity=NOT_SIZE, damping=[("both", ValueError), (1, ValueError)], tapered=NOT_BOOL
        )
    ),
    *table(
        lambda **one: Simulator(**{"scene": Scene(LATTICE), **one}),
        scene=[(None, TypeError), (LATTICE, TypeError)],
        copies=NOT_COUNT,
        seed=[*NOT_WHOLE, (-1, ValueError)],
        threads=[*(c for c in NOT_COUNT if c[0] is not None)],
    ),
    *table(presets.flag, rows=NOT_COUNT, cols=NOT_COUNT, length=NOT_POSITIVE, height=NOT_POSITIVE, density=NOT_POSITIVE),
    *table(presets.flag, taper=NOT_POSITIVE, stiffness=NOT_SIZE, viscosity=NOT_SIZE, dtype=[("int64", ValueError)]),
    *table(presets.report_flag, layers=[(0, ValueError), (3, ValueError), ("1", ValueError)], rows=NOT_COUNT, cols=NOT_COUNT),
    *table(Scene(LATTICE).scaled, stiffness=NOT_SIZE, viscosity=NOT_SIZE),
]


@pytest.mark.parametrize(("make", "name", "value", "error"), CONSTRUCTORS)
def test_bad_arguments_are_refused_by_name_and_value(make, name, value, error):
    with pytest.raises(error) as caught:
        make(**{name: value})
    message = str(caught.value)
    assert name in message
    if not isinstance(value, (tuple, list, float)) or (isinstance(value, float) and make is not CosineWind):
        assert repr(value) in message or str(value) in message


def test_unknown_kinds_and_fields_are_refused():
    with pytest.raises(TypeError, match="kinds must be effect classes"):
        Scene(LATTICE).without("Shear")
    with pytest.raises(TypeError, match="speed"):
        Scene(LATTICE).replace(speed=3)
    with pytest.raises(NotImplementedError, match="bind"):
        effects.Effect().bind(None)


GOOD = np.zeros((1, 6, 7, 3))


def spoiled(value):
    array = GOOD.copy()
    array[0, 5, 6, 2] = value
    return array


def foreign_states():
    other_size = Simulator(presets.flag(4, 5), copies=2).get_state()
    other_count = Simulator(windy(), copies=3).get_state()
    other_dtype = Simulator(windy("float32"), copies=2).get_state()
    other_pins = Simulator(windy(pinned="sleeve"), copies=2).get_state()
    fewer = Simulator(windy().without(CosineWind), copies=2).get_state()
    order = Simulator(windy().replace(effects=windy().effects[::-1]).without(Gravity).adding(AirDrag()), copies=2).get_state()
    return [other_size, other_count, other_dtype, other_pins, fewer, order]


ANGLES = (1.0, 2.0, 3.0)
CALLS = [
    *(("step", {"n": value}, error) for value, error in [*NOT_WHOLE, (-1, ValueError)]),
    *(("advance", {"seconds": value}, error) for value, error in NOT_SIZE),
    *(
        (f"set_{name}", {name: value}, error)
        for name in ("positions", "velocities")
        for value, error in [
            (np.zeros((6, 7, 3)), ValueError),
            (np.zeros((3, 1, 6, 7, 3)), ValueError),
            (1.0, ValueError),
            ("abc", TypeError),
            (spoiled(np.nan), ValueError),
            (spoiled(np.inf), ValueError),
        ]
    ),
    *(("set_mast", {"position": value}, error) for value, error in NOT_VECTOR),
    *(("set_mast", {"position": (1, 1, 1), "tilt": value}, error) for value, error in [(ANGLES, ValueError), ("a", TypeError)]),
    *(
        ("set_mast", {"position": (1, 1, 1), "yaw": value}, error)
        for value, error in [((1, 2, 3), ValueError), (np.nan, ValueError)]
    ),
    *(("set_wind", {"amplitude": (9, 9, 9), "frequency": value}, error) for value, error in NOT_VECTOR),
    *(("set_wind", {"mean": (9, 9, 9), "amplitude": value}, error) for value, error in NOT_VECTOR),
    *(("set_wind", {"amplitude": (9, 9, 9), "mean": value}, error) for value, error in [(np.zeros((3, 3)), ValueError)]),
    *(("set_parameters", {"stiffness_scale": value}, error) for value, error in NOT_SIZE),
    *(("set_parameters", {"viscosity_scale": value}, error) for value, error in NOT_SIZE),
    *(("set_state", {"state": value}, error) for value, error in [(None, TypeError), ("state", TypeError)]),
]


@pytest.mark.parametrize(("method", "arguments", "error"), CALLS)
def test_a_refused_call_names_its_argument_and_changes_nothing(method, arguments, error):
    sim = Simulator(windy(), copies=2)
    sim.step(5)
    before = bits(sim)
    with pytest.raises(error) as caught:
        getattr(sim, method)(**arguments)
    name = list(arguments)[-1]
    assert (name) in str(caught.value)
    assert bits(sim) == before
    untouched = Simulator(windy(), copies=2)
    untouched.step(5)
    for one in (sim, untouched):
        one.step(5)
    assert same(sim, untouched)


@pytest.mark.parametrize("index", range(6))
def test_a_state_of_another_scene_is_refused(index):
    sim = Simulator(windy(), copies=2)
    sim.step(5)
    before = bits(sim)
    with pytest.raises(ValueError, match="state must"):
        sim.set_state(foreign_states()[index])
    assert bits(sim) == before


LIMIT = max_timestep(windy())


@pytest.mark.parametrize(
    ("name", "scene"),
    [
        ("timestep", windy(timestep=0.4 * LIMIT)),
        ("stiffness", windy(timestep=0.5 * LIMIT, stiffness=250.0)),
        ("viscosity", windy(timestep=0.5 * LIMIT, viscosity=0.01)),
        ("AirDrag", windy(timestep=0.5 * LIMIT, drag=1.0)),
        ("Gravity", windy(timestep=0.5 * LIMIT).adding(Gravity(1.6))),
        ("integrator", windy(timestep=0.5 * LIMIT, integrator=integrators.RK4())),
        ("pinned", windy(timestep=0.5 * LIMIT, pinned="none")),
        ("pinned", windy(timestep=0.5 * LIMIT, pinned=(0, 7, 14, 21, 28, 36))),
        ("mass", windy(timestep=0.5 * LIMIT, taper=0.2)),
        ("dtype", windy("float32", timestep=0.5 * LIMIT)),
        ("spacing", windy(timestep=0.5 * LIMIT, length=1.4)),
    ],
)
@pytest.mark.parametrize("copies", [None, [1]])
def test_a_state_of_another_scene_is_refused_by_name(name, scene, copies):
    sim = Simulator(windy(timestep=0.5 * LIMIT), copies=2)
    sim.step(5)
    before = bits(sim)
    with pytest.raises(ValueError, match=rf"state must come from a simulator of the same .*{name}"):
        sim.set_state(Simulator(scene, copies=2).get_state(), copies=copies)
    assert bits(sim) == before


def test_what_does_not_touch_the_motion_may_differ():
    sim = Simulator(windy(timestep=0.5 * LIMIT), copies=2)
    other = Simulator(windy(timestep=0.5 * LIMIT, perturbation=0.1, allow_unstable=True), copies=2)
    other.step(9)
    sim.set_state(pickle.loads(pickle.dumps(other.get_state())))
    for one in (sim, other):
        one.step(9)
    assert same(sim, other)


def test_some_copies_do_not_go_on_under_other_factors():
    sim, other = Simulator(windy(), copies=2), Simulator(windy(), copies=2)
    other.set_parameters(stiffness_scale=0.5)
    before = bits(sim)
    with pytest.raises(ValueError, match=r"stiffness_scale and viscosity_scale, \(1.0, 1.0\).*got \(0.5, 1.0\)"):
        sim.set_state(other.get_state(), copies=[0])
    assert bits(sim) == before
    sim.set_state(other.get_state())
    sim.set_state(other.get_state(), copies=[0])


@pytest.mark.parametrize("copies", [np.array([1, 0]), range(2), (np.int64(0), 1)])
def test_copies_may_be_any_sequence_of_numbers(copies):
    sim, other = Simulator(windy(), copies=2), Simulator(windy(), copies=2)
    other.step(5)
    sim.set_state(other.get_state(), copies=copies)
    np.testing.assert_array_equal(sim.positions, other.positions)


@pytest.mark.parametrize(
    ("copies", "error"),
    [
        ([2], ValueError),
        ([-1], ValueError),
        ([0.5], TypeError),
        (["0"], TypeError),
        (0, TypeError),
        (1.0, TypeError),
        (np.array(1), TypeError),
        (np.array([0.0, 1.0]), TypeError),
        (np.array([True, False]), TypeError),
        ("01", TypeError),
        ([[0], [1]], TypeError),
        ([None], TypeError),
    ],
)
def test_copies_out_of_range_are_refused(copies, error):
    sim = Simulator(windy(), copies=2)
    state = sim.get_state()
    sim.step(5)
    before = bits(sim)
    with pytest.raises(error, match="copies must be"):
        sim.set_state(state, copies=copies)
    assert bits(sim) == before
    assert isinstance(state, State)


def test_wind_in_a_scene_without_wind_is_refused():
    with pytest.raises(ValueError, match=r"CosineWind\(\)"):
        Simulator(windy().without(CosineWind)).set_wind(amplitude=(1, 1, 1))


def test_numbers_too_large_for_the_scenes_arithmetic_are_refused():
    sim = Simulator(windy("float32"))
    before = bits(sim)
    for setter in (sim.set_positions, sim.set_velocities):
        with pytest.raises(ValueError, match=r"1e\+300"):
            setter(spoiled(1e300))
        assert bits(sim) == before
