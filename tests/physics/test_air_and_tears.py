"""Air on cloth that tears, is large or is fast: by an own sum over triangles, and by scenes that must fly on."""

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, effects, integrators, presets
from flag_env.physics.effects import AirPressure, Structural, Tearing


def pressure(x, v, air, effect, cell_area, intact):
    """Force on every particle [N], (rows, cols, 3): triangle by triangle, |u| A no more than max_speed times the area at rest."""
    force = np.zeros_like(x)
    for row, col in np.argwhere(intact):
        a, b, c, d = (row, col), (row, col + 1), (row + 1, col + 1), (row + 1, col)
        for corners in ((a, b, c), (a, c, d)):
            p, q, r = (x[corner] for corner in corners)
            double = np.cross(q - p, r - p)
            area = 0.5 * np.linalg.norm(double)
            n = double / (2 * area)
            u = air - np.mean([v[corner] for corner in corners], axis=0)
            speed, across = np.linalg.norm(u), u @ n
            share = min(1.0, effect.max_speed * 0.5 * cell_area / (speed * area))
            total = effect.normal * speed * across * n + effect.friction * speed * (u - across * n)
            total += effect.lift * across * (speed * n - across * u / speed)
            for corner in corners:
                force[corner] += share * 0.5 * effect.density * area * total / 3.0
    return force


@pytest.mark.parametrize("stretch", [1.0, 3.0])
@pytest.mark.parametrize("wind", [5.0, 19.0])
def test_torn_cells_feel_no_air_and_large_or_fast_ones_no_more_than_the_bound(stretch, wind):
    lattice = Lattice(1, 5, 6, (0.1, 0.12), mass=0.01, pinned="none")
    air = AirPressure((wind, 2.0, 1.0), normal=1.3, lift=0.4, friction=0.05)
    sim = Simulator(Scene(lattice, (Structural(0.0, 0.0), air, Tearing(stretch - 1.0 + 0.5)), integrators.ExplicitEuler(), 1e-4))
    random = np.random.default_rng(0)
    x = stretch * sim.positions[0, 0] + 0.02 * random.standard_normal((5, 6, 3))
    x[2:, 4:, 0] += 0.1  # tears the sides that cross the corner's edge
    sim.set_positions(x[None])
    sim.set_velocities(random.standard_normal((1, 5, 6, 3)))
    sim.step(1)
    intact = sim.intact_cells()[0, 0]
    assert 0 < intact.sum() < intact.size
    before = sim.velocities[0, 0]
    expected = pressure(sim.positions[0, 0], before, np.array(air.mean), air, 0.1 * 0.12, intact)  # as explicit Euler takes it
    sim.step(1)
    np.testing.assert_allclose(sim.velocities[0, 0] - before, 1e-4 * expected / 0.01, rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize(("wind", "seconds"), [(8.0, 15.0), (15.0, 8.0), (60.0, 2.0)])
@pytest.mark.parametrize("strain", [0.05, 0.1])
def test_a_flag_that_tears_in_a_storm_flies_on_and_so_do_its_rags(wind, seconds, strain):
    sim = Simulator(presets.storm_flag(10, 16, wind=wind).adding(Tearing(strain)), copies=2, seed=1)
    sim.advance(seconds)
    assert (sim.intact_cells().mean(axis=(1, 2, 3)) < 1.0).all() or strain > 0.05
    assert np.abs(sim.velocities).max() < 3.0 * wind + 10.0


@pytest.mark.parametrize("method", [*integrators.CATALOGUE[:5], integrators.Strang(2)], ids=repr)
@pytest.mark.parametrize("stiffness", [0.3, 3.0, 30.0])
def test_soft_cloth_in_the_air_stays_stable_at_the_automatic_step(method, stiffness):
    scene = presets.flag(8, 12, stiffness=stiffness).without(effects.CosineWind).adding(AirPressure((8.0, 0.0, 0.0)))
    sim = Simulator(scene.replace(integrator=method))
    sim.advance(20.0)
    assert np.abs(sim.velocities).max() < 20.0


def test_a_wind_above_the_largest_speed_is_refused_by_name():
    with pytest.raises(ValueError, match=r"mean and amplitude of the air must stay within max_speed = 20 m/s, got 25 m/s"):
        AirPressure((15.0, 0.0, 0.0), amplitude=(0.0, 20.0, 0.0))
    sim = Simulator(presets.storm_flag(5, 8))
    state = sim.get_state()
    with pytest.raises(ValueError, match=r"must stay within max_speed = 20 m/s, got 60 m/s"):
        sim.set_wind(mean=(60.0, 0.0, 0.0))
    sim.step(3)
    twin = Simulator(presets.storm_flag(5, 8))
    twin.set_state(state)
    twin.step(3)
    np.testing.assert_array_equal(sim.positions, twin.positions)
    Simulator(presets.storm_flag(5, 8, wind=60.0)).step(1)  # the preset leaves room


def test_cells_are_torn_as_their_sides_are():
    lattice = Lattice(2, 3, 4, 0.1, pinned="none")
    sim = Simulator(Scene(lattice, (Structural(0.0, 0.0), Tearing(0.2)), timestep=1e-4), copies=2)
    assert sim.intact_cells().shape == (2, 2, 2, 3)
    assert sim.intact_cells().all()
    x = sim.positions
    x[1, 0, 0, 2:, 0] += 0.03  # the side from column 1 to 2 of row 0, in one layer of one copy
    sim.set_positions(x)
    sim.step(1)
    torn = np.argwhere(~sim.intact_cells()).tolist()
    assert torn == [[1, 0, 0, 1], [1, 0, 0, 2]] or torn == [[1, 0, 0, 1]]
    assert Simulator(presets.rope(5)).intact_cells().size == 0
