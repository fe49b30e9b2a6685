"""Self-collision keeps momentum, makes no energy, and collides two particles as in the formulas."""

import dataclasses

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, effects, max_timestep, presets
from flag_env.physics.effects import SelfCollision
from tests.physics.test_self_collision_crossings import CLOTH, layered

BEADS = Lattice(1, 5, 8, 0.1, 0.02, 0.3, "none")  # without springs: particles that only collide


def crowd(sim, seed=0, spread=0.12, speed=1.0):
    """Place the particles at random, close to each other."""
    random = np.random.default_rng(seed)
    shape = (*sim.scene.lattice.shape, 3)
    sim.set_positions(spread * random.standard_normal(shape))
    sim.set_velocities(speed * random.standard_normal(shape))


def momentum(sim):
    return np.einsum("i,ik->k", sim.scene.lattice.masses, sim.velocities[0].reshape(-1, 3))


def test_contact_keeps_momentum_and_the_centre_of_mass():
    sim = Simulator(Scene(BEADS, (SelfCollision(0.15, friction=0.5, restitution=0.3),), timestep=1e-3))
    crowd(sim)
    before, start = momentum(sim), np.average(sim.positions[0].reshape(-1, 3), axis=0, weights=BEADS.masses)
    sim.step(300)
    np.testing.assert_allclose(momentum(sim), before, rtol=0, atol=1e-13)
    centre = np.average(sim.positions[0].reshape(-1, 3), axis=0, weights=BEADS.masses)
    np.testing.assert_allclose(centre, start + 0.3 * before / BEADS.masses.sum(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.7])
def test_contact_makes_no_kinetic_energy(friction, restitution):
    sim = Simulator(Scene(BEADS, (SelfCollision(0.15, friction, restitution),), timestep=1e-3))
    crowd(sim)
    first = last = sim.energy()["kinetic"][0]
    for _ in range(200):
        sim.step()
        now = sim.energy()["kinetic"][0]
        assert now <= last * (1 + 1e-12)
        last = now
    assert last < 0.95 * first


@pytest.mark.parametrize("friction", [0.0, 0.2, 5.0])
@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_two_particles_collide_as_in_the_formulas(friction, restitution):
    """Impulse along the line of centres, Coulomb friction across it, in closed form."""
    lattice = Lattice(1, 1, 4, 0.5, 0.02, 0.4, "none")
    sim = Simulator(Scene(lattice, (SelfCollision(0.1, friction, restitution),), timestep=1e-3))
    x, v = np.zeros((2, 1, 1, 4, 3))
    x[0, 0, :, 0] = 0.0, 3.0, 6.0, 0.0995
    v[0, 0, 0], v[0, 0, 3] = (1.0, 0.0, 0.5), (-1.0, 0.3, 0.0)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.step()
    inverse = 1 / lattice.masses[[0, 3]]
    gap = x[0, 0, 3] + 1e-3 * v[0, 0, 3] - x[0, 0, 0] - 1e-3 * v[0, 0, 0]
    n, rate = gap / np.linalg.norm(gap), v[0, 0, 3] - v[0, 0, 0]
    impulse = -(1 + restitution) * (rate @ n) / inverse.sum()
    slide = rate - (rate @ n) * n
    size = np.linalg.norm(slide)
    total = impulse * n - min(friction * impulse, size / inverse.sum()) * slide / size
    np.testing.assert_allclose(sim.velocities[0, 0, 0, [0, 3]], v[0, 0, [0, 3]] + np.outer([-inverse[0], inverse[1]], total))
    now = sim.positions[0, 0, 0]
    assert np.linalg.norm(now[3] - now[0]) == pytest.approx(0.1, rel=1e-12)
    np.testing.assert_array_equal(sim.velocities[0, 0, 0, 1:3], 0)


def test_pinned_particles_stay_and_stop_what_hits_them():
    lattice = Lattice(1, 1, 4, 0.5, 0.02, pinned=(0,))
    sim = Simulator(Scene(lattice, (SelfCollision(0.1),), timestep=1e-3))
    x, v = np.zeros((2, 1, 1, 4, 3))
    x[0, 0, :, 0] = 0.0, 3.0, 6.0, 0.2
    v[0, 0, 3, 0] = -1.0
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.step(300)
    np.testing.assert_array_equal(sim.positions[0, 0, 0, 0], 0)
    np.testing.assert_allclose(sim.positions[0, 0, 0, 3], (0.1, 0, 0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(sim.velocities[0, 0, 0, 3], 0, rtol=0, atol=1e-12)


def test_energy_does_not_grow_when_sheets_meet():
    scene = layered(CLOTH, drag=0.0).adding(SelfCollision(friction=0.0)).replace(timestep=2e-4)
    sim = Simulator(scene)
    v = np.zeros((*scene.lattice.shape, 3))
    v[0, ..., 1] = 2.0
    sim.set_velocities(v)
    energies = []
    for _ in range(100):
        energies.append(sum(value[0] for value in sim.energy().values()))
        sim.step(20)
    assert min(energies) < 0.8 * energies[0]
    assert np.diff(energies).max() < 2e-3 * energies[0]


@pytest.mark.parametrize("share", [0.5, 0.7])
@pytest.mark.parametrize("speed", [5.0, 20.0, 60.0])
def test_undamped_cloth_that_bounces_as_much_as_is_allowed_gains_no_energy(speed, share):
    """Without friction, damping and air, thrown at random: contact may only take energy out."""
    flag = presets.flag(8, 10, viscosity=0.0, drag=0.0).without(effects.CosineWind)
    scene = flag.replace(lattice=dataclasses.replace(flag.lattice, layers=2, pinned="none")).adding(effects.Gravity(0.0))
    scene = scene.adding(SelfCollision(friction=0.0, restitution=0.7))
    sim = Simulator(scene.replace(timestep=share * max_timestep(scene)))
    sim.set_velocities(speed * np.random.default_rng(0).standard_normal((*scene.lattice.shape, 3)) / 2)
    first = sum(value[0] for value in sim.energy().values())
    for _ in range(40):
        sim.step(250)
        assert sum(value[0] for value in sim.energy().values()) < 1.05 * first
