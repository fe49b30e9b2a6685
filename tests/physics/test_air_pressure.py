"""The wind's force on the cloth against closed forms, its symmetries, energy and step limit."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flag_env.physics import Lattice, Scene, Simulator, max_timestep, presets
from flag_env.physics.effects import AirDrag, AirPressure, CosineWind, Gravity, Gusts, Structural
from flag_env.physics.effects.base import BindContext
from tests.physics.scenes import leapfrog_scene

LATTICE = Lattice(1, 5, 7, (0.1, 0.08), 0.02, 0.3, "none")
AREA = 0.6 * 0.32
REST = LATTICE.rest_positions.reshape(-1, 3)
FULL = AirPressure(density=1.3, normal=1.1, lift=0.7, friction=0.2)


def forces(effect, x=REST, v=None, wind=(0.0, 0.0, 0.0), lattice=LATTICE, dtype="float64", lag=0.0):
    """Force on every particle [N], shape (particles, 3)."""
    effect = dataclasses.replace(effect, mean=tuple(wind))
    data = effect.bind(BindContext(lattice, np.dtype(dtype), 1, 1e-3, 0))
    f, effect_work = np.zeros((2, 3, lattice.size), dtype)
    v = np.zeros_like(x) if v is None else v
    data.force(data, 0, np.array(x.T, dtype, order="C"), np.array(v.T, dtype, order="C"), f, effect_work, lag)
    assert f.dtype == dtype
    return f.T.copy()


def pose(seed=0, lattice=LATTICE):
    random = np.random.default_rng(seed)
    x = lattice.rest_positions.reshape(-1, 3) + 0.03 * random.standard_normal((lattice.size, 3))
    return x, random.standard_normal((lattice.size, 3))


def plain(effect, x, v, wind, lattice=LATTICE):
    """The formula of the module's head, triangle by triangle, each term by itself."""
    f = np.zeros_like(x)
    index = np.arange(lattice.size).reshape(lattice.shape)
    for sheet in index:
        for row in range(lattice.rows - 1):
            for col in range(lattice.cols - 1):
                a, b, c, d = sheet[row, col], sheet[row, col + 1], sheet[row + 1, col + 1], sheet[row + 1, col]
                for corners in ([a, b, c], [a, c, d]):
                    p, q, r = x[corners]
                    cross = np.cross(q - p, r - p)
                    area = np.linalg.norm(cross) / 2
                    n = cross / (2 * area)
                    u = wind - v[corners].mean(axis=0)
                    speed, across = np.linalg.norm(u), u @ n
                    pressure = effect.normal * speed * across * n
                    lift = effect.lift * across * speed * np.cross(np.cross(u / speed, n), u / speed)
                    friction = effect.friction * speed * (u - across * n)
                    f[corners] += effect.density * area / 2 * (pressure + lift + friction) / 3 / lattice.layers
    return f


@pytest.mark.parametrize("layers", [1, 2])
def test_every_triangle_obeys_the_formula(layers):
    lattice = dataclasses.replace(LATTICE, layers=layers, spacing=(0.1, 0.08, 0.05))
    x, v = pose(0, lattice)
    wind = np.array([3.0, -2.0, 1.0])
    found = forces(FULL, x, v, wind, lattice)
    np.testing.assert_allclose(found, plain(FULL, x, v, wind, lattice), rtol=0, atol=1e-13 * np.abs(found).max())


@pytest.mark.parametrize("lift", [0.0, 0.7])
def test_a_plate_across_the_stream(lift):
    """F = rho A C_N U^2 / 2 along the stream; nothing else."""
    effect = AirPressure(normal=1.1, lift=lift, friction=0.2)
    for speed in (5.0, -5.0):
        total = forces(effect, wind=(0.0, speed, 0.0)).sum(axis=0)
        expected = 0.5 * 1.2 * AREA * 1.1 * speed * abs(speed)
        np.testing.assert_allclose(total, [0.0, expected, 0.0], rtol=1e-12, atol=1e-12)


def test_a_plate_along_the_stream_feels_friction_alone():
    for wind in ((5.0, 0.0, 0.0), (0.0, 0.0, -5.0), (3.0, 0.0, 4.0)):
        total = forces(FULL, wind=wind).sum(axis=0)
        np.testing.assert_allclose(total, 0.5 * 1.3 * AREA * 0.2 * 5.0 * np.array(wind), rtol=1e-12, atol=1e-14)
    assert not forces(AirPressure(friction=0.0), wind=(5.0, 0.0, 3.0)).any()


@pytest.mark.parametrize("angle", [0.05, 0.4, 1.0, 1.5])
def test_lift_and_drag_of_an_inclined_plate(angle):
    """Drag C_N sin^2 + C_F cos^2 and lift (C_N + C_L - C_F) sin cos of the angle between plate and stream."""
    stream, side = np.array([math.cos(angle), math.sin(angle), 0.0]), np.array([-math.sin(angle), math.cos(angle), 0.0])
    total = forces(FULL, wind=6.0 * stream).sum(axis=0) / (0.5 * 1.3 * AREA * 36.0)
    s, c = math.sin(angle), math.cos(angle)
    assert total @ stream == pytest.approx(1.1 * s**2 + 0.2 * c**2, rel=1e-12)
    assert total @ side == pytest.approx((1.1 + 0.7 - 0.2) * s * c, rel=1e-12)


def test_a_plate_that_moves_with_the_wind_feels_nothing():
    wind = np.array([3.0, -2.0, 1.0])
    assert np.abs(forces(FULL, pose()[0], np.broadcast_to(wind, REST.shape), wind)).max() < 1e-14
    # and only the difference counts
    x, v = pose()
    a, b = forces(FULL, x, v, wind), forces(FULL, x, v + wind, 2 * wind)
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-13 * np.abs(a).max())


def test_the_diagonals_of_a_plane_do_not_matter():
    """A plate numbered from its other side has the other diagonals: same total force and torque about its centre."""
    wind = (3.0, 1.0, 2.0)
    mirrored = REST * [-1.0, 1.0, 1.0] + [0.6, 0.0, 0.0]
    results = []
    for x in (REST, mirrored):
        f = forces(FULL, x, wind=wind)
        results.append((f.sum(axis=0), np.cross(x - [0.3, 0.0, 0.16], f).sum(axis=0)))
    np.testing.assert_allclose(results[0][0], results[1][0], rtol=1e-12)
    for _, torque in results:
        np.testing.assert_allclose(torque, 0.0, atol=1e-13)


def test_forces_turn_with_the_flag_and_the_wind():
    x, v = pose()
    wind = np.array([3.0, -2.0, 1.0])
    full = replace(FULL, max_speed=1e3)
    turn = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    found, turned = forces(full, x, v, wind), forces(full, x @ turn.T, v @ turn.T, turn @ wind)
    np.testing.assert_allclose(turned, found @ turn.T, rtol=0, atol=1e-13 * np.abs(found).max())
    # no length is built in: the force goes with the square of lengths and of speeds
    np.testing.assert_allclose(forces(full, 3.0 * x, 2.0 * v, 2.0 * wind), 36.0 * found, rtol=1e-11)


@pytest.mark.parametrize("part", ["normal", "lift", "friction", "all"])
def test_still_air_only_takes_energy_out(part):
    names = ("normal", "lift", "friction")
    effect = FULL if part == "all" else AirPressure(**{name: float(name == part) for name in names})
    for seed in range(50):
        x, v = pose(seed)
        f = forces(effect, x, v)
        power, scale = (f * v).sum(), (np.abs(f) * np.abs(v)).sum()
        if part == "lift":
            assert abs(power) < 1e-12 * scale
        else:
            assert power < -1e-3 * scale


def test_no_air_no_force():
    assert not forces(AirPressure(density=0.0), *pose(), wind=(5.0, 1.0, 0.0)).any()


def test_single_precision_is_kept():
    x, v = pose()
    wind = (5.0, 1.0, -2.0)
    double, single = (forces(FULL, x, v, wind, dtype=dtype) for dtype in ("float64", "float32"))
    np.testing.assert_allclose(single, double, rtol=0, atol=2e-6 * np.abs(double).max())
    for effect in (FULL, dataclasses.replace(FULL, gusts=Gusts())):
        data = effect.bind(BindContext(LATTICE, np.dtype("float32"), 1, 1e-3, 0))
        fixed = [*data.cloth, *(data.turbulence[:2] if effect.gusts else ())]
        assert {np.asarray(value).dtype.name for value in fixed} == {"float32", "int64"}


def test_the_declared_damping_is_attained_and_never_exceeded():
    """The symmetric part of -dF/dv against the bound, for random poses with |u| A at what max_speed allows."""
    drag = np.kron(FULL.drag(LATTICE), np.ones(3))
    n = drag.size
    plate = {"x": REST, "v": np.zeros_like(REST)}
    cases = [(plate["x"], plate["v"], (0.0, 0.999 * FULL.max_speed, 0.0), 0.74)]
    x, v = REST + [[0.0, 0.3, 0.0]] * np.sin(9.0 * REST), np.zeros_like(REST)
    for seed in range(4):
        direction = np.random.default_rng(seed).standard_normal(3)
        cases.append((x, v, FULL.max_speed / 6 * direction / np.linalg.norm(direction), 0.0))
    for x, v, wind, least in cases:
        slope = np.empty((n, n))
        for i, index in enumerate(np.ndindex(x.shape)):
            shift = np.zeros_like(x)
            shift[index] = 1e-4
            slope[:, i] = (forces(FULL, x, v + shift, wind) - forces(FULL, x, v - shift, wind)).ravel() / 2e-4
        scaled = -0.5 * (slope + slope.T) / np.sqrt(np.outer(drag, drag))
        assert least * 2.2 / 2.9 < np.linalg.eigvalsh(scaled)[-1] < 1.0 + 1e-6


def test_the_step_limit_covers_the_damping():
    """A plate held in its pose and thrown through still air at the greatest speed: no step gives it energy."""
    effect = AirPressure(max_speed=10.0)
    scene = leapfrog_scene(LATTICE, (effect,))
    limit = max_timestep(scene)
    assert limit == pytest.approx(2.0 / (effect.drag(LATTICE) / LATTICE.masses).max(), rel=1e-6)
    with pytest.raises(ValueError, match="limit"):
        Simulator(scene.replace(timestep=1.01 * limit))
    for timestep, calm in ((limit, True), (8.0 * limit, False)):
        sim = Simulator(scene.replace(timestep=timestep, allow_unstable=True))
        sim.set_velocities(np.array([0.0, 9.0, 0.0]) + 0.3 * pose()[1].reshape(*LATTICE.shape, 3))
        energies = []
        for _ in range(100 if calm else 5):
            energies.append((sim.get_state().velocities[0] ** 2 @ LATTICE.masses).sum())
            sim.step()
            sim.set_positions(LATTICE.rest_positions)
        assert (np.diff(energies) < 0).all() == calm


@pytest.mark.parametrize("gusty", [False, True])
def test_strong_wind_does_not_blow_up(gusty):
    """At the automatic timestep, wind along and across the flag, up to 30 m/s, set on at once."""
    speeds = (10.0, 20.0, 30.0)
    gusts = Gusts(5.0, 5.0, 30.0) if gusty else None
    scene = presets.flag(10, 16).without(Gravity, CosineWind).adding(AirPressure(max_speed=30.0, gusts=gusts))
    sim = Simulator(scene, copies=2 * len(speeds))
    sim.set_wind(mean=[[s, 0.0, 0.0] for s in speeds] + [[0.0, s, 0.0] for s in speeds])
    sim.advance(3.0)
    links = np.linalg.norm(np.diff(sim.positions, axis=3), axis=-1) / scene.lattice.spacings[0]
    assert links.max() < 2.0
    assert np.abs(sim.velocities).max() < 80.0


def test_the_wind_swings_and_can_be_changed():
    effect = AirPressure(amplitude=(0.0, 4.0, 0.0), frequency=(0.0, 3.0, 0.0), phase=(0.0, 0.5, 0.0))
    total = forces(effect, wind=(0.0, 2.0, 0.0), lag=0.1).sum(axis=0)[1]
    assert total == pytest.approx(0.6 * AREA * 1.2 * (2.0 + 4.0 * math.cos(0.8)) ** 2, rel=1e-12)


def test_turbulent_air_is_that_of_gusts():
    """The columns see the same air as those that Gusts pushes, from the same stream."""
    gusts = Gusts(2.0, 1.0, 4.0, mean=(0.0, 0.0, 0.0), rate=1.0)
    context = BindContext(LATTICE, np.dtype("float64"), 2, 0.01, 7)
    push, press = gusts.bind(context), AirPressure(mean=(0.0, 6.0, 0.0), gusts=gusts, friction=0.0).bind(context)
    still = np.zeros((3, LATTICE.size))
    f, effect_work = np.zeros((2, 3, LATTICE.size))
    push.force(push, 1, still, still, f, effect_work, 0.004)
    air = f.T / LATTICE.masses[:, None] + [0.0, 6.0, 0.0]
    found = np.zeros_like(f)
    x = np.ascontiguousarray(REST.T)
    press.force(press, 1, x, still, found, effect_work, 0.004)
    np.testing.assert_allclose(found.T, forces(AirPressure(friction=0.0), REST, -air), rtol=1e-10, atol=1e-14)


def test_a_turbulent_state_continues_to_the_bit():
    scene = presets.flag(10, 16).without(Gravity, CosineWind).adding(AirPressure((6.0, 0.0, 0.0), gusts=Gusts(5.0, 5.0, 30.0)))
    sim, other = Simulator(scene, copies=2), Simulator(scene, copies=2, seed=4)
    sim.step(60)
    other.set_state(sim.get_state())
    single = Simulator(scene)
    single.step(60)
    for each in (sim, other, single):
        each.step(60)
    np.testing.assert_array_equal(sim.positions, other.positions)
    np.testing.assert_array_equal(sim.positions[0], single.positions[0])


@pytest.mark.parametrize(
    "wrong", [{"density": -1.0}, {"normal": -0.1}, {"mean": (1.0, 2.0)}, {"max_speed": float("inf")}, {"gusts": CosineWind()}]
)
def test_wrong_arguments_are_named(wrong):
    with pytest.raises((ValueError, TypeError), match=next(iter(wrong))):
        AirPressure(**wrong)


@pytest.mark.parametrize("lattice", [Lattice(1, 1, 5), Lattice(1, 5, 1), Lattice(1, 4, 4, dimensions=2)])
def test_a_lattice_without_triangles_is_refused(lattice):
    with pytest.raises(ValueError, match="AirPressure needs"):
        Scene(lattice, (Structural(), AirDrag(), AirPressure()))
