"""Running: steps add up, no time is lost, copies, threads and processes do not know of each other."""

import pickle
from fractions import Fraction

import numpy as np
import pytest

from flag_env.physics import Diverged, Lattice, Scene, Simulator
from flag_env.physics.effects import Gravity
from tests.physics.test_simulator_state import DTYPES, same, windy


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
