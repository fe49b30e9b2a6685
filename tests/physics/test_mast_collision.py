"""Checks the pole against closed forms and in storms."""

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, max_timestep, presets
from flag_env.physics.effects import MastCollision, Structural, Tearing

RADIUS = 0.1
LATTICE = Lattice(1, 3, 3, 0.5, 1.0, pinned=(0, 3, 6))  # a mast of length 1 and six free particles, without springs
FLAG = presets.flag(12, 16)
MEAN_MASS = FLAG.lattice.masses.mean()
HIT = (0, 0, 1, 1)  # copy and particle that is thrown
TOLERANCE = {"float64": 1e-12, "float32": 2e-6}
"""Depth inside the pole that rounding may leave [m]."""


def thrown(position, velocity, dtype="float64", timestep=1e-3, **options):
    sim = Simulator(Scene(LATTICE, (MastCollision(RADIUS, **options),), timestep=timestep, dtype=dtype))
    x, v = sim.positions, sim.velocities
    x[HIT], v[HIT] = position, velocity
    sim.set_positions(x)
    sim.set_velocities(v)
    return sim


def depth(sim, below, radius):
    """How deep the deepest free particle is inside the pole [m], by another formula than the simulator's."""
    x = sim.positions[0]
    foot, top = x[0, 0, 0], x[0, -1, 0]
    e = (top - foot) / np.linalg.norm(top - foot)
    low, high = foot - below * e, top
    points = x.reshape(-1, 3)[~sim.scene.lattice.fixed]
    distance = np.linalg.norm(np.cross(points - low, e), axis=1)
    s = (points - low) @ e
    distance = np.where(s < 0, np.linalg.norm(points - low, axis=1), distance)
    distance = np.where(s > np.linalg.norm(high - low), np.linalg.norm(points - high, axis=1), distance)
    return (radius - distance).max()


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("speed", [0.5, 20.0, 400.0])  # up to 0.4 m a step: across the whole pole
@pytest.mark.parametrize("offset", [0.0, 0.03, 0.099, -0.05])
def test_a_particle_shot_at_the_pole_slides_on_along_its_tangent(offset, speed, dtype):
    """Entering at n = (sqrt(r^2 - b^2), b)/r with velocity (-c, 0), it keeps c b/r along the tangent, and the motion along z."""
    sim = thrown((np.sqrt(RADIUS**2 - offset**2) + 3.5e-3 * speed, offset, 0.5), (-speed, 0.0, 0.7), dtype, friction=0.0)
    for _ in range(4):
        assert sim.velocities[HIT][0] == pytest.approx(-speed)
        sim.step()
        assert depth(sim, 1.0, RADIUS) < TOLERANCE[dtype]
    n = np.array([np.sqrt(RADIUS**2 - offset**2), offset, 0.0]) / RADIUS
    tangent = np.array([-n[1], n[0], 0.0])
    expected = speed * n[1] * tangent + np.array([0.0, 0.0, 0.7])
    np.testing.assert_allclose(sim.velocities[HIT], expected, rtol=0, atol=speed * (1e-10 if dtype == "float64" else 1e-4))


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("friction", [0.2, 10.0])
def test_bounce_and_friction_are_coulombs(friction, restitution):
    sim = thrown((0.15, 0.0, 0.5), (-10.0, 3.0, 4.0), friction=friction, restitution=restitution)
    x, v = np.array([0.15, 0.0]), np.array([-10.0, 3.0])
    a, b, c = v @ v, x @ v, x @ x - RADIUS**2
    n = np.append((x + v * (-b - np.sqrt(b * b - a * c)) / a) / RADIUS, 0.0)
    u = np.array([-10.0, 3.0, 4.0])
    rate, slide = u @ n, u - (u @ n) * n
    size = np.linalg.norm(slide)
    expected = -restitution * rate * n + slide * max(0.0, 1 + friction * (1 + restitution) * rate / size)
    for _ in range(12):
        sim.step()
        if not np.array_equal(sim.velocities[HIT], u):
            break
    np.testing.assert_allclose(sim.velocities[HIT], expected, rtol=0, atol=1e-9)


def test_a_miss_changes_no_bit():
    ends = []
    for effects in ((), (MastCollision(RADIUS),)):
        sim = Simulator(Scene(LATTICE, effects, timestep=1e-3))
        x, v = sim.positions, sim.velocities
        x[HIT], v[HIT] = (1.0, 0.1001, 0.5), (-30.0, 0.0, 0.3)
        x[0, 0, 1, 2], v[0, 0, 1, 2] = (1.0, 0.0, 1.2), (-30.0, 0.0, 0.0)  # over the top
        sim.set_positions(x)
        sim.set_velocities(v)
        sim.step(100)
        ends.append((sim.positions, sim.velocities))
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize(("height", "stopped"), [(-0.9, True), (-1.09, True), (-1.11, False), (1.09, True), (1.11, False)])
def test_the_pole_ends_where_it_says(height, stopped):
    sim = thrown((0.5, 0.0, height), (-5.0, 0.0, 0.0), friction=0.0)
    sim.step(200)
    assert np.array_equal(sim.velocities[HIT], (-5.0, 0.0, 0.0)) != stopped


def test_a_moving_pole_pushes():
    """Head-on at 1 m/s the particle ends on the pole's surface and moves along with it; a tilted pole is followed too."""
    sim = thrown((0.5, 0.0, 0.5), (0.0, 0.0, 0.0))
    sim.set_mast(position=(1.0, 0.0, 0.0))
    sim.step(1000)
    np.testing.assert_allclose(sim.positions[HIT], (1.1, 0.0, 0.5), rtol=0, atol=1e-9)
    np.testing.assert_allclose(sim.velocities[HIT], (1.0, 0.0, 0.0), rtol=0, atol=1e-9)
    sim = thrown((0.4, 0.0, 0.8), (0.0, 0.0, 0.0))
    for turn in range(100):
        sim.set_mast(tilt=(0.0, 0.01 * turn))
        sim.step(10)
        assert depth(sim, 1.0, RADIUS) < 1e-4  # pinned particles are put in place after the last step of a call
    assert sim.positions[HIT][0] > 0.6


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("position", [(0.0, 0.0, 0.5), (1e-20, 0.0, 0.5), (0.0, 0.05, 0.5), (0.0, 0.0, 1.0), (0.0, 0.0, -1.05)])
def test_a_particle_inside_comes_out_finite(position, dtype):
    sim = thrown(position, (0.0, 0.0, 0.0), dtype)
    sim.step()
    assert depth(sim, 1.0, RADIUS) < TOLERANCE[dtype]
    assert np.isfinite(sim.positions).all()


def test_a_mast_of_no_length_is_finite():
    sim = thrown((0.01, 0.0, 0.0), (0.0, 0.0, 0.0))
    x = sim.positions
    x[0, 0, :, 0] = 0.0
    sim.set_positions(x)
    sim.step()
    np.testing.assert_allclose(sim.positions[HIT], (RADIUS, 0, 0), rtol=0, atol=1e-12)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_storm_blows_no_particle_into_the_pole(dtype):
    radius = 0.04
    inside = []
    for effects in ((), (MastCollision(radius, below=0.5),)):
        sim = Simulator(FLAG.replace(dtype=dtype).adding(*effects))
        sim.set_wind(amplitude=(30 * MEAN_MASS, 40 * MEAN_MASS, 25 * MEAN_MASS), frequency=(7, 11, 9))
        deepest = -np.inf
        for _ in range(10_000 if effects else 2_000):
            sim.step()
            deepest = max(deepest, depth(sim, 0.5, radius))
        inside.append(deepest)
    assert inside[0] > 0.01
    assert -0.02 < inside[1] < TOLERANCE[dtype]  # at rest it is 6 cm away


def pierced(x, below):
    """How many triangles of cells of (layers, rows, cols, 3) that the mast does not hold the pole's axis pierces.

    Moeller and Trumbore's test of a ray against a triangle, for the cells cut along either diagonal.
    """
    foot, top = x[0, 0, 0], x[0, -1, 0]
    axis = top - foot
    start = foot - below * axis / np.linalg.norm(axis)
    ray = top - start
    corners = np.stack([x[:, :-1, :-1], x[:, :-1, 1:], x[:, 1:, 1:], x[:, 1:, :-1]], axis=-2)[:, :, 1:]
    corners = corners.reshape(-1, 4, 3)
    found = 0
    for three in ((0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3)):
        a, b, c = corners[:, three].transpose(1, 0, 2)
        across = np.cross(ray, c - a)
        volume = np.einsum("ij,ij->i", b - a, across)
        with np.errstate(divide="ignore", invalid="ignore"):
            from_a = start - a
            one = np.einsum("ij,ij->i", from_a, across) / volume
            turned = np.cross(from_a, b - a)
            two = turned @ ray / volume
            along = np.einsum("ij,ij->i", c - a, turned) / volume
            found += int(((one > 0) & (two > 0) & (one + two < 1) & (along > 0) & (along < 1)).sum())
    return found


def test_the_outside_check_sees_a_pole_through_a_cell():
    x = FLAG.lattice.rest_positions.copy()
    assert pierced(x, 0.5) == 0
    x[0, 3:5, 4:6] += x[0, 4, 0] + (0.01, 0.02, 0.0) - x[0, 3:5, 4:6].mean(axis=(0, 1))
    x[0, 3, 4:6, 1] -= 0.1
    x[0, 4, 4:6, 1] += 0.1
    assert pierced(x, 0.5) >= 2


def wrap(sim, speed, turn):
    """Whip the mast through the cloth, in wind that turns."""
    sim.set_mast((0.4 * np.sin(speed * turn), 0.4 * np.sin(1.3 * speed * turn), 0.0), (0.2 * np.sin(0.7 * speed * turn), 0.0))
    angle = 0.05 * turn
    sim.set_wind(amplitude=(0, 0, 0), mean=(25 * MEAN_MASS * np.cos(angle), 25 * MEAN_MASS * np.sin(angle), 6 * MEAN_MASS))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("radius", [0.01, 0.03])
@pytest.mark.parametrize("speed", [0.25, 0.3])
def test_the_axis_never_passes_through_a_cell(speed, radius, dtype):
    """The cloth is thrown round the pole and over its top; were particles alone kept out, the axis would be in it as often."""
    seen = []
    for effects in ((), (MastCollision(radius, below=0.5),)):
        sim = Simulator(FLAG.replace(dtype=dtype).adding(*effects))
        frames = 0
        for turn in range(400):
            wrap(sim, speed, turn)
            sim.advance(0.02)
            frames += pierced(sim.positions[0], 0.5) > 0
        seen.append(frames)
    assert seen[0] > 10
    assert seen[1] == 0


def test_the_pole_passes_between_the_corners_of_torn_cells():
    """Rows that are torn from end to end let the pole through; whole ones stop at it."""
    ends = []
    for strain in (0.1, np.inf):
        lattice = Lattice(1, 4, 4, 0.1, 1e-3)
        scene = Scene(lattice, (Structural(0.0), MastCollision(0.01), Tearing(strain)), timestep=1e-3)
        sim = Simulator(scene)
        x = sim.positions
        x[..., 0] *= 1.5
        sim.set_positions(x)
        sim.step()
        x[0, 0, :, 2] = x[0, 0, :, 0] + (-0.05, 0.02, 0.0)
        x[0, 0, :, 3] = x[0, 0, :, 0] + (0.05, 0.02, 0.0)  # edges that stand beside the pole and go through it
        sim.set_positions(x)
        v = np.zeros_like(x)
        v[0, 0, :, 2:, 1] = -10.0
        sim.set_velocities(v)
        sim.step(4)
        ends.append(sim.positions[0, 0, :, 2:, 1])
    np.testing.assert_allclose(ends[0], -0.02, rtol=0, atol=1e-12)
    assert (ends[1] > -0.01).all()


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_states_copies_and_threads_agree_to_the_bit(dtype):
    scene = FLAG.replace(dtype=dtype).adding(MastCollision(0.04))
    sims = [Simulator(scene, copies=3, threads=threads) for threads in (1, 2)]
    for sim in sims:
        sim.set_wind(amplitude=(30 * MEAN_MASS, 40 * MEAN_MASS, 25 * MEAN_MASS), frequency=(7, 11, 9))
        sim.set_mast(position=(0.2, 0.1, 0.0), tilt=(0.1, -0.2))
        sim.step(300)
    np.testing.assert_array_equal(sims[0].positions, sims[1].positions)
    state = sims[0].get_state()
    for sim in sims:
        sim.set_state(state)
        sim.step(200)
    np.testing.assert_array_equal(sims[0].positions, sims[1].positions)
    alone = Simulator(scene)
    alone.set_state(Simulator(scene).get_state())
    alone.set_wind(amplitude=(30 * MEAN_MASS, 40 * MEAN_MASS, 25 * MEAN_MASS), frequency=(7, 11, 9))
    alone.set_mast(position=(0.2, 0.1, 0.0), tilt=(0.1, -0.2))
    alone.step(300)
    np.testing.assert_array_equal(alone.positions[0], state.positions[0].T.reshape(alone.positions[0].shape).astype(float))


def test_the_step_limit_stays_and_what_makes_no_sense_is_refused():
    assert max_timestep(FLAG.adding(MastCollision())) == max_timestep(FLAG)
    for wrong in ({"radius": -0.1}, {"radius": np.inf}, {"below": -1.0}, {"friction": -1.0}, {"restitution": 2.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            MastCollision(**wrong)
    with pytest.raises(ValueError, match="radius must leave the free particles outside"):
        FLAG.adding(MastCollision(radius=0.5))
    with pytest.raises(ValueError, match="two pinned particles"):
        presets.flag(pinned="none").adding(MastCollision())
    with pytest.raises(ValueError, match="dimensions"):
        presets.sheet().adding(MastCollision())
    FLAG.replace(lattice=Lattice(2, 4, 5, pinned="sleeve")).adding(MastCollision())
