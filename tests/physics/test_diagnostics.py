"""Measurements agree with what physics says of them, computed another way."""

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, diagnostics, effects, integrators, presets


def test_momentum_grows_by_the_weight():
    """A free flag gains m g t, and its links none."""
    scene = presets.flag(4, 6, pinned="none", integrator=integrators.RK4()).without(effects.AirDrag, effects.CosineWind)
    sim = Simulator(scene)
    sim.step(100)
    expected = np.array([0.0, 0.0, -9.81 * sim.time * scene.lattice.masses.sum()])
    np.testing.assert_allclose(diagnostics.momentum(scene.lattice, sim.velocities), [expected], rtol=0, atol=1e-12)


def test_pinned_particles_carry_no_momentum():
    scene = presets.flag(4, 6)
    still = np.zeros((2, *scene.lattice.shape, 3))
    still[..., 0, :] = 5.0
    assert not diagnostics.momentum(scene.lattice, still).any()


def test_strain_of_a_cloth_stretched_evenly():
    lattice = Lattice(2, 3, 4, (0.1, 0.12, 0.15), 0.02, 0.3, "none")
    stretched = np.stack([lattice.rest_positions * factor for factor in (1.0, (1.2, 1.2, 1.2), (1.5, 1.0, 1.0))])
    strain = diagnostics.strain(lattice, stretched)
    along, up = 2 * 3 * 3, 2 * 2 * 4
    assert strain.shape == (3, along + up)
    np.testing.assert_allclose(strain[0], 0.0, atol=1e-14)
    np.testing.assert_allclose(strain[1], 0.2, atol=1e-14)
    np.testing.assert_allclose(np.sort(strain[2]), [0.0] * up + [0.5] * along, atol=1e-14)


def test_a_lone_particle_has_no_links():
    lattice = Lattice(1, 1, 1, 0.1, 0.02, 1.0, "none")
    assert diagnostics.strain(lattice, lattice.rest_positions[None]).shape == (1, 0)


def test_wind_of_each_copy():
    sim = Simulator(presets.flag(3, 4), copies=2)
    sim.set_wind(amplitude=[(1, 2, 3), (0, 0, 0)], frequency=(0.5, 1.0, 2.0), mean=(4.0, 0.0, 0.0))
    sim.step(50)
    swing = [1, 2, 3] * np.cos(np.array([0.5, 1.0, 2.0]) * sim.time)
    np.testing.assert_allclose(sim.wind(), [swing + np.array([4.0, 0.0, 0.0]), (4, 0, 0)], rtol=0, atol=1e-12)
    assert Simulator(Scene(Lattice(1, 2, 2))).wind() is None


def test_winds_in_two_units_have_no_sum():
    sim = Simulator(presets.flag(3, 4).adding(effects.AirPressure()))
    with pytest.raises(ValueError, match=r"winds in one unit .*N and m/s"):
        sim.wind()
