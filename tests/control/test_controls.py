"""Controls against closed forms: lags, ranges, and that two controls together do what each does alone."""

import numpy as np
import pytest

from flag_env.control import CONTROLS, BothControl, MastControl, MastYawControl, WindControl, WindFrequencyControl
from flag_env.physics import Simulator, presets

SCENE = presets.flag(3, 4)


@pytest.mark.parametrize("name", ["wind", "mast", "both", "wind+frequency", "mast+yaw"])
def test_actuators_follow_their_set_points_and_come_back_to_a_state(name):
    scene = presets.flag(3, 4, pinned="sleeve") if name == "mast+yaw" else SCENE
    simulator, rng = Simulator(scene, copies=2), np.random.default_rng(0)
    control = CONTROLS[name](scene, 2)
    control.reset(simulator, np.arange(2))
    assert not control.apply(simulator, np.full((2, control.size), np.nan))
    actions = rng.uniform(-1, 1, (6, 2, control.size)).astype(np.float32)
    for action in actions[:3]:
        assert control.apply(simulator, action)
    kept, after = control.get_state(1), control.state.copy()
    for action in actions[3:]:
        control.apply(simulator, action)
    assert not np.array_equal(control.state, after)
    control.set_state(0, kept)
    control.set_state(1, kept)
    np.testing.assert_array_equal(control.state, after[[1, 1]])
    control.apply(simulator, actions[3][[1, 1]])
    np.testing.assert_array_equal(control.state[0], control.state[1])


def test_both_is_wind_and_mast():
    simulators = [Simulator(SCENE) for _ in range(2)]
    both, wind, mast = BothControl(SCENE, 1), WindControl(SCENE, 1), MastControl(SCENE, 1)
    for control, simulator in ((both, simulators[0]), (wind, simulators[1]), (mast, simulators[1])):
        control.reset(simulator, np.arange(1))
    for action in np.random.default_rng(1).uniform(-1, 1, (10, 8)):
        both.apply(simulators[0], action)
        wind.apply(simulators[1], action[:3])
        mast.apply(simulators[1], action[3:])
        for simulator in simulators:
            simulator.advance(0.04)
    np.testing.assert_array_equal(both.state, np.concatenate([wind.state, mast.state], axis=1))
    np.testing.assert_array_equal(simulators[0].positions, simulators[1].positions)


def test_frequency_and_amplitude_follow_with_the_lag_and_the_phase_goes_on():
    """d phase / dt = f, so that the wind at any time is a cos(sum of f dt)."""
    simulator, control = Simulator(SCENE), WindFrequencyControl(SCENE, 1)
    control.reset(simulator, np.arange(1))
    u, f, phase = np.zeros(3), WindFrequencyControl.frequency.copy(), np.zeros(3)
    action = np.array([1.0, -0.5, 0.25, 1.0, 0.0, -1.0])
    share = 1 - np.exp(-0.04 / 0.2)
    for _ in range(30):
        control.apply(simulator, action)
        simulator.advance(0.04)
        u += share * (action[:3] - u)
        f += share * (3.0 * (action[3:] + 1.0) - f)
        phase += f * 0.04
    full = float(SCENE.lattice.masses.mean()) * WindControl.gain
    np.testing.assert_allclose(simulator.wind()[0], full * u * np.cos(phase), rtol=0.02, atol=1e-6)


def test_a_sleeve_turns_with_the_mast():
    scene = presets.flag(3, 4, pinned="sleeve")
    simulator, control = Simulator(scene), MastYawControl(scene, 1)
    control.reset(simulator, np.arange(1))
    for _ in range(60):
        control.apply(simulator, np.array([0, 0, 0, 0, 0, 1.0]))
        simulator.advance(0.04)
    sleeve = simulator.positions[0, 0, :, 1, :2]
    angle = np.arctan2(sleeve[:, 1], sleeve[:, 0])
    np.testing.assert_allclose(angle, 1.0, atol=1e-9)  # at the edge of its range
    with pytest.raises(ValueError, match="sleeve"):
        MastYawControl(SCENE, 1)


def test_ranges_are_attributes_of_a_subclass():
    class Gentle(MastControl):
        speed = np.full(5, 0.1)
        reach = np.full(5, 0.05)

    simulator, control = Simulator(SCENE), Gentle(SCENE, 1)
    control.reset(simulator, np.arange(1))
    for _ in range(100):
        control.apply(simulator, np.ones(5))
        simulator.advance(0.04)
    np.testing.assert_allclose(control.state[0, :5], 1.0)
    assert simulator.positions[0, 0, 0, 0, 0] == pytest.approx(0.05)
