"""A state of another scene is refused by the name of what differs; what does not touch the motion may differ."""

import pickle

import numpy as np
import pytest

from flag_env.physics import Simulator, integrators, max_timestep, presets
from flag_env.physics.effects import AirDrag, CosineWind, Gravity
from tests.physics.test_simulator_state import bits, same, windy


def foreign_states():
    other_size = Simulator(presets.flag(4, 5), copies=2).get_state()
    other_count = Simulator(windy(), copies=3).get_state()
    other_dtype = Simulator(windy("float32"), copies=2).get_state()
    other_pins = Simulator(windy(pinned="sleeve"), copies=2).get_state()
    fewer = Simulator(windy().without(CosineWind), copies=2).get_state()
    order = Simulator(windy().replace(effects=windy().effects[::-1]).without(Gravity).adding(AirDrag()), copies=2).get_state()
    return [other_size, other_count, other_dtype, other_pins, fewer, order]


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
