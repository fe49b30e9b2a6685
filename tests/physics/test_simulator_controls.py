"""Controls: mast, wind and parameters change while a simulator runs, copy by copy, and arrive where they were asked to."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flag_env.physics import Lattice, Simulator, max_timestep, presets
from flag_env.physics.effects import CosineWind
from tests.physics.scenes import leapfrog_scene
from tests.physics.test_simulator_state import DTYPES, bits, same, windy


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
    sim = Simulator(leapfrog_scene(Lattice(1, 1, 1, 0.1, m, pinned="none"), (wind,), timestep=h), copies=2)
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
    scene = leapfrog_scene(Lattice(1, 1, 1, 0.1, 0.5, pinned="none"), (CosineWind((1.0, 1.0, 1.0)),), timestep=1e-3)
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
