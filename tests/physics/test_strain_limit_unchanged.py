"""What the strain limit must not change: momentum, energy, the timestep, and what is within the limit."""

import dataclasses

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, max_timestep, presets
from flag_env.physics.effects import Bending, CosineWind, Shear, StrainLimit, Structural
from flag_env.physics.effects.strain_limit import TOLERANCE
from flag_env.physics.integrators import Leapfrog
from tests.physics.test_strain_limit import STRONG, largest, momentum, most


def free_cloth(dtype="float64", seed=0, taper=0.3):
    lattice = Lattice(1, 7, 9, 0.1, 0.02, taper, "none")
    links = Structural(50.0), Shear(20.0), Bending(1.0)
    sim = Simulator(Scene(lattice, (*links, StrainLimit(0.05)), timestep=1e-3, dtype=dtype))
    sim.set_velocities(np.random.default_rng(seed).standard_normal((*lattice.shape, 3)))
    return sim


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_free_cloth_keeps_its_momentum(dtype):
    sim = free_cloth(dtype)
    before = momentum(sim)
    worst = 0.0
    for _ in range(300):
        sim.step(1)
        worst = max(worst, largest(sim))
        np.testing.assert_allclose(momentum(sim), before, rtol=0, atol=2e3 * np.finfo(dtype).eps)
    assert worst > 0.05 * 0.999  # at the limit


@pytest.mark.parametrize("seed", range(3))
def test_kinetic_energy_never_grows_without_springs(seed):
    """A projection on a convex set brings no two poses further apart: |x' - x_old| <= |x - x_old| = h |v|, masses as weights.

    Up to the tolerance, by which the old pose may lie outside.
    """
    sim = free_cloth(seed=seed)
    scene = sim.scene.without(Structural, Shear, Bending)
    sim = Simulator(scene)
    sim.set_velocities(np.random.default_rng(seed).standard_normal((*scene.lattice.shape, 3)))
    energies = []
    for _ in range(500):
        sim.step(1)
        energies.append(sim.energy()["kinetic"][0])
    assert np.diff(energies).max() <= 0.01 * TOLERANCE * energies[0]
    assert energies[-1] < 0.9 * energies[0]


def test_total_energy_does_not_grow_with_springs():
    scene = presets.flag(8, 12, stiffness=20.0, drag=0.0, viscosity=0.0).without(CosineWind)
    sim = Simulator(scene.adding(StrainLimit(0.02)).replace(timestep=2e-4))
    totals = []
    for _ in range(100):
        sim.step(50)
        totals.append(sum(value[0] for value in sim.energy().values()))
    assert max(totals) < totals[0] + 1e-3 * (totals[0] - min(totals))
    assert largest(sim) <= most(0.02)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_it_does_nothing_within_the_limit(dtype):
    scene = presets.flag(6, 9, dtype=dtype, integrator=Leapfrog()).adding(STRONG)
    sims = [Simulator(given) for given in (scene, scene.adding(StrainLimit(10.0)))]
    for sim in sims:
        sim.step(500)
    assert largest(sims[0]) > 0.03
    np.testing.assert_array_equal(sims[0].get_state().positions, sims[1].get_state().positions)
    np.testing.assert_array_equal(sims[0].get_state().velocities, sims[1].get_state().velocities)


def test_it_costs_no_timestep():
    for scene in (presets.flag(6, 8), presets.sheet(6, 8), presets.two_layer_flag(6, 8)):
        assert max_timestep(scene.adding(StrainLimit(0.0))) == max_timestep(scene)


def test_copies_and_states_continue_to_the_bit():
    scene = presets.flag(6, 9, stiffness=20.0).adding(STRONG, StrainLimit(0.03))
    many, one = Simulator(scene, copies=3), Simulator(scene)
    many.set_wind(mean=[[0.0, 0.0, 0.0], [0.02, 0.005, 0.0], [0.1, 0.1, 0.1]])
    one.set_state(dataclasses.replace(one.get_state(), positions=many.get_state().positions[1:2]))
    for sim in (many, one):
        sim.step(200)
    np.testing.assert_array_equal(many.get_state().positions[1], one.get_state().positions[0])
    state = many.get_state()
    many.step(50)
    other = Simulator(scene, copies=3, seed=7)
    other.set_state(state)
    other.step(50)
    np.testing.assert_array_equal(many.get_state().positions, other.get_state().positions)
