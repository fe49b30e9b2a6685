"""Checks trajectories against closed forms, conservation laws, symmetries and the scheme's own exact solution."""

import math

import numpy as np
import pytest
import scipy.special
from scipy.spatial.transform import Rotation

from flag_env.physics import Lattice, Simulator
from flag_env.physics.effects import AirDrag, Bending, CrossLayer, Gravity, Shear, Structural
from tests.physics.scenes import leapfrog_scene

G = 9.81


def place(sim, positions, velocities=0.0):
    positions = np.asarray(positions, float)
    sim.set_positions(positions)
    sim.set_velocities(np.broadcast_to(velocities, positions.shape))
    return sim


def trajectory(sim, steps):
    """Positions of copy 0 at steps 0, 1, ..., (steps + 1, layers, rows, cols, 3)."""
    frames = [sim.positions[0]]
    for _ in range(steps):
        sim.step(1)
        frames.append(sim.positions[0])
    return np.array(frames)


def frequency(amplitudes, timestep):
    """Angular frequency of a pure oscillation: a[n+1] + a[n-1] = 2 cos(w h) a[n]."""
    a, b = amplitudes[1:-1], amplitudes[2:] + amplitudes[:-2]
    return math.acos((a @ b) / (2 * a @ a)) / timestep


def free_cloth(damping="isotropic", viscosity=0.02, timestep=5e-4, gravity=0.0):
    """A free two-layer cloth with every kind of link, deformed and moving."""
    lattice = Lattice(2, 4, 5, 0.1, 0.01, 0.3, "none")
    kinds = ((Structural, 200.0), (Shear, 80.0), (Bending, 20.0), (CrossLayer, 60.0))
    effects = tuple(kind(k, viscosity, damping, tapered=True) for kind, k in kinds)
    random = np.random.default_rng(5)
    positions = 1.1 * lattice.rest_positions + 0.02 * random.standard_normal((*lattice.shape, 3))
    velocities = 0.5 * random.standard_normal((*lattice.shape, 3)) + np.cross([0.5, -1.0, 2.0], positions)
    return leapfrog_scene(lattice, (*effects, Gravity(gravity)), timestep=timestep), positions, velocities


def total(scene, positions, velocities):
    """Momentum and angular momentum about the origin."""
    m = scene.lattice.masses[:, None]
    x, v = positions.reshape(-1, 3), velocities.reshape(-1, 3)
    return (m * v).sum(axis=0), (m * np.cross(x, v)).sum(axis=0)


# -- equilibria --------------------------------------------------------------------------------------------------------------


def test_hanging_chain_has_the_lengths_of_statics():
    k, length, n = 500.0, 0.05, 20
    lattice = Lattice(1, 1, n + 1, length, 0.01, 0.1)
    sim = Simulator(leapfrog_scene(lattice, (Gravity(), Structural(k, 0.0), AirDrag(40.0))))
    down = np.zeros((1, 1, n + 1, 3))
    down[..., 2] = -length * np.arange(n + 1)
    place(sim, down).advance(4.0)
    x = sim.positions[0, 0, 0]
    masses = 0.01 * (1 - 0.9 * np.arange(n + 1) / n)
    extension = G * np.cumsum(masses[::-1])[::-1][1:] / k
    np.testing.assert_allclose(-np.diff(x[:, 2]) - length, extension, rtol=0, atol=1e-12)
    assert x[-1, 2] == pytest.approx(-1.015862770, abs=1e-12)
    assert extension[0] == pytest.approx(0.002069910, abs=1e-12)
    assert not x[:, :2].any()


def test_chain_between_two_posts_is_the_elastic_catenary():
    k, length, n = 500.0, 0.05, 20
    sim = Simulator(
        leapfrog_scene(Lattice(1, 1, n + 1, length, 0.01, 1.0, "ends"), (Gravity(), Structural(k, 0.0), AirDrag(15.0)))
    )
    start = np.zeros((1, 1, n + 1, 3))
    start[..., 0] = np.linspace(0.0, 0.8, n + 1)
    start[..., 2] = -0.25 * np.sin(np.linspace(0, np.pi, n + 1))
    place(sim, start).advance(8.0)
    x = sim.positions[0, 0, 0]
    link = np.diff(x, axis=0)
    stretched = np.linalg.norm(link, axis=1)
    tension = (k * (1 - length / stretched))[:, None] * link
    np.testing.assert_allclose(tension[:, 0], 0.6014744805, rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.diff(tension[:, 2]), 0.01 * G, rtol=0, atol=1e-10)
    assert -x[:, 2].min() == pytest.approx(0.290038488711, abs=1e-11)


# -- frequencies -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "mode", "known"), [(0, 1, 69.959619571), (0, 9, 441.707654031), (1, 1, 28.560895091), (2, 9, 180.326394643)]
)
def test_string_rings_at_the_schemes_own_frequency(axis, mode, known):
    lattice = Lattice(1, 1, 11, 0.05, 0.01, 1.0, "ends")
    sim = Simulator(leapfrog_scene(lattice, (Structural(500.0, 0.0),), timestep=1e-3))
    shape = np.sin(np.arange(11) * mode * np.pi / 10)
    shape[[0, -1]] = 0.0
    start = 1.2 * lattice.rest_positions
    centre = start.copy()
    start[0, 0, :, axis] += (1e-4 if axis == 0 else 1e-7) * shape  # along the string the model is linear, across it is not
    a = (trajectory(place(sim, start), 2000) - centre)[:, 0, 0, :, axis] @ shape
    h = sim.timestep
    assert frequency(a, h) == pytest.approx(2 / h * math.asin(known * h / 2), rel=1e-9)


def test_drum_rings_at_the_schemes_own_frequency():
    lattice = Lattice(1, 8, 10, 0.05, 0.01)
    row, col = np.divmod(np.arange(80), 10)
    border = tuple(np.flatnonzero((row % 7 == 0) | (col % 9 == 0)))
    sim = Simulator(leapfrog_scene(Lattice(1, 8, 10, 0.05, 0.01, 1.0, border), (Structural(500.0, 0.0),), timestep=1e-3))
    shape = (np.sin(row * np.pi / 7) * np.sin(col * np.pi / 9)).reshape(8, 10)
    shape.ravel()[list(border)] = 0.0
    start = 1.2 * lattice.rest_positions
    start[0, ..., 1] = 1e-7 * shape
    a = (trajectory(place(sim, start), 2000)[:, 0, :, :, 1] * shape).sum(axis=(1, 2))
    h = sim.timestep
    assert frequency(a, h) == pytest.approx(2 / h * math.asin(51.532920111 * h / 2), rel=1e-9)


def pendulum_period(angle, stiffness, timestep):
    """Twice the time between the pendulum's first two passes of the vertical."""
    sim = Simulator(leapfrog_scene(Lattice(1, 1, 2, 1.0, 1.0), (Gravity(), Structural(stiffness, 0.0)), timestep=timestep))
    bob = (1.0 + G * math.cos(angle) / stiffness) * np.array([math.sin(angle), 0.0, -math.cos(angle)])
    x = trajectory(place(sim, np.array([[[np.zeros(3), bob]]])), int(2.0 / timestep))[:, 0, 0, 1]
    swing = np.arctan2(x[:, 0], -x[:, 2])
    passes = []
    for n in np.flatnonzero(swing[:-1] * swing[1:] < 0)[:2]:
        near = np.arange(n - 2, n + 4)
        cubic = np.polynomial.Polynomial.fit(swing[near], near, 5)  # time as a function of the angle
        passes.append(cubic(0.0) * timestep)
    return 2 * (passes[1] - passes[0])


@pytest.mark.parametrize(("degrees", "known"), [(60, 2.152874666881), (90, 2.367841947576)])
def test_pendulum_period_is_the_elliptic_integral(degrees, known):
    angle = math.radians(degrees)
    assert known == pytest.approx(4 / math.sqrt(G) * scipy.special.ellipk(math.sin(angle / 2) ** 2), abs=1e-12)

    def without_step_error(stiffness):
        coarse, fine = (pendulum_period(angle, stiffness, h) for h in (1e-3, 5e-4))
        return (4 * fine - coarse) / 3

    soft, stiff = without_step_error(1e5), without_step_error(2e5)
    assert soft - known > 1e-5  # the elongation matters, in proportion to 1/k
    assert 2 * stiff - soft == pytest.approx(known, rel=1e-7)


# -- exact solutions of the scheme -------------------------------------------------------------------------------------------


def test_free_fall_is_the_schemes_own_parabola():
    sim = Simulator(leapfrog_scene(Lattice(1, 1, 1, 0.1, 0.3, pinned="none"), (Gravity(),), timestep=1e-3))
    z = trajectory(sim, 1000)[:, 0, 0, 0, 2]
    n = np.arange(1001)
    np.testing.assert_allclose(z, -G * sim.timestep**2 * n * (n + 1) / 2, rtol=1e-13, atol=0)


@pytest.mark.parametrize("damping", ["isotropic", "axial"])
@pytest.mark.parametrize("zeta", [0.05, 0.5, 1.5])
def test_damped_oscillator_follows_the_roots_of_its_polynomial(zeta, damping):
    k, m = 400.0, 0.01
    viscosity = 2 * zeta * math.sqrt(k * m)
    sim = Simulator(leapfrog_scene(Lattice(1, 1, 2, 0.1, m), (Structural(k, viscosity, damping),), timestep=1e-3))
    start = np.zeros((1, 1, 2, 3))
    start[..., 1, 0] = 0.11
    x = trajectory(place(sim, start), 300)[:, 0, 0, 1, 0] - 0.1
    h = sim.timestep
    K, Z = h * h * k / m, h * viscosity / m
    roots = np.roots([1.0, -(2 - K - Z), 1 - Z])
    weights = np.linalg.solve(np.array([[1, 1], roots]), [0.01, 0.01 * (1 - K)])
    exact = (weights * roots ** np.arange(301)[:, None]).sum(axis=1)
    np.testing.assert_allclose(x, exact.real, rtol=0, atol=1e-15)


def test_isotropic_damper_brakes_the_rotation_of_a_dumbbell():
    m, z, h, n = 0.02, 0.4, 1e-3, 400
    scene = leapfrog_scene(Lattice(1, 1, 2, 0.2, m, pinned="none"), (Structural(300.0, z),), timestep=h)
    velocities = np.array([[[[0.1, -0.5, 0.2], [0.3, 0.5, -0.6]]]])
    sim = place(Simulator(scene), [[[[-0.1, 0, 0], [0.1, 0, 0]]]], velocities - velocities.mean(axis=2, keepdims=True))
    before = total(scene, sim.positions, sim.velocities)[1]
    sim.step(n)
    after = total(scene, sim.positions, sim.velocities)[1]
    np.testing.assert_allclose(after, before * (1 - 2 * z * h / m) ** n * (1 - z * h / m), rtol=1e-11, atol=1e-20)


# -- conservation laws and symmetries ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("damping", "viscosity"), [("isotropic", 0.0), ("isotropic", 0.02), ("axial", 0.02)])
def test_a_free_cloth_keeps_its_momenta(damping, viscosity):
    scene, positions, velocities = free_cloth(damping, viscosity)
    sim = place(Simulator(scene), positions, velocities)
    linear, angular = total(scene, sim.positions, sim.velocities)
    sim.step(1000)
    linear_after, angular_after = total(scene, sim.positions, sim.velocities)
    np.testing.assert_allclose(linear_after, linear, rtol=0, atol=1e-13 * np.abs(linear).max())
    if damping == "axial" or viscosity == 0:
        np.testing.assert_allclose(angular_after, angular, rtol=0, atol=1e-12 * np.abs(angular).max())
    else:
        assert np.abs(angular_after - angular).max() > 1e-2 * np.abs(angular).max()


@pytest.mark.parametrize("damping", ["isotropic", "axial"])
def test_rotating_the_start_rotates_the_motion(damping):
    scene, positions, velocities = free_cloth(damping)
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix().T
    sim, turned = place(Simulator(scene), positions, velocities), place(Simulator(scene), positions @ turn, velocities @ turn)
    for one in (sim, turned):
        one.step(200)
    np.testing.assert_allclose(turned.positions, sim.positions @ turn, rtol=0, atol=1e-12)
    np.testing.assert_allclose(turned.velocities, sim.velocities @ turn, rtol=0, atol=1e-10)


@pytest.mark.parametrize("damping", ["isotropic", "axial"])
def test_a_moving_observer_sees_the_same_motion(damping):
    scene, positions, velocities = free_cloth(damping)
    drift = np.array([3.0, -2.0, 1.0])
    sim, moving = place(Simulator(scene), positions, velocities), place(Simulator(scene), positions, velocities + drift)
    for one in (sim, moving):
        one.step(200)
    np.testing.assert_allclose(moving.positions, sim.positions + drift * sim.time, rtol=0, atol=1e-12)
    np.testing.assert_allclose(moving.velocities, sim.velocities + drift, rtol=0, atol=1e-10)


def test_the_undamped_scheme_runs_backwards():
    scene, positions, velocities = free_cloth(viscosity=0.0, gravity=G)
    sim = place(Simulator(scene), positions, velocities)
    sim.step(300)
    last = sim.positions
    sim.step(1)
    place(sim, last[0], -sim.get_state().velocities[0].T.reshape(positions.shape))  # the w between x_n+1 and x_n, reversed
    assert np.abs(last[0] - positions).max() > 0.1
    sim.step(300)
    np.testing.assert_allclose(sim.positions[0], positions, rtol=0, atol=1e-11)


def test_reversed_gravity_gives_the_mirror_image():
    lattice = Lattice(1, 5, 6, 0.1, 0.01, 0.3)
    links = (Structural(200.0, 0.02), Shear(2.0, 0.02), Bending(1.0, 0.02))
    start = lattice.rest_positions + np.array([0.0, 1.0, 0.0]) * np.linspace(0, 0.1, 6)[:, None]
    down = place(Simulator(leapfrog_scene(lattice, (Gravity(G), *links), timestep=1e-3)), start)
    up = place(Simulator(leapfrog_scene(lattice, (Gravity(-G), *links), timestep=1e-3)), start)
    for one in (down, up):
        one.step(500)
    mirrored = down.positions[:, :, ::-1] * [1, 1, -1] + [0, 0, 0.4]
    assert np.abs(down.positions[0] - start).max() > 0.1
    np.testing.assert_allclose(up.positions, mirrored, rtol=0, atol=1e-12)


# -- order of accuracy -------------------------------------------------------------------------------------------------------


def energies(timestep):
    """Total energy of a free undamped cloth after every step but the start, which is off by half a kick."""
    scene, positions, velocities = free_cloth(viscosity=0.0, timestep=timestep, gravity=G)
    sim = place(Simulator(scene), positions, velocities)
    result = []
    for _ in range(round(0.1 / timestep)):
        sim.step(1)
        result.append(sum(sim.energy().values())[0])
    return np.array(result)


def test_energy_error_is_of_second_order():
    coarse, fine = (np.ptp(energies(h)) for h in (1e-4, 5e-5))
    assert coarse < 1e-3 * energies(1e-4).mean()
    assert coarse / fine == pytest.approx(4.0, abs=0.03)


def test_halving_the_step_halves_the_error():
    def end(timestep):
        scene, positions, velocities = free_cloth(timestep=timestep, gravity=G)
        sim = place(Simulator(scene), positions, velocities)
        sim.advance(0.1)
        assert sim.time == pytest.approx(0.1, rel=1e-12)
        return sim.positions

    a, b, c = (end(h) for h in (1e-4, 5e-5, 2.5e-5))
    assert np.linalg.norm(a - b) / np.linalg.norm(b - c) == pytest.approx(2.0, abs=0.02)
