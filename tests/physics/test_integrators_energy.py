"""Every integrator keeps, drives or loses energy as it declares; those that are reversible run there and back again."""

import numpy as np
import pytest

from flag_env.physics import Simulator
from flag_env.physics.effects import AirDrag, CosineWind
from flag_env.physics.integrators import RK4, ExplicitEuler, Implicit
from tests.physics.test_integrators_order import REVERSIBLE, beginning, smooth


def conservative(method, **changes):
    return smooth("none", method, **changes).without(AirDrag, CosineWind)


def total_energy(sim):
    return sum(sim.energy().values())[0]


@pytest.mark.parametrize("method", REVERSIBLE, ids=repr)
def test_there_and_back_again(method):
    scene = conservative(method, timestep=4e-3)
    sim = Simulator(scene)
    x, v = beginning(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.step(150)
    assert np.abs(sim.positions[0] - x).max() > 0.1
    there = sim.positions
    sim.set_velocities(-sim.velocities)
    sim.step(150)
    np.testing.assert_allclose(sim.positions[0], x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(sim.velocities[0], -v, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(there.shape, sim.positions.shape)


def energies(method, timestep, seconds=3.0):
    scene = conservative(method, timestep=timestep)
    sim = Simulator(scene)
    x, v = beginning(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    found = [total_energy(sim)]
    for _ in range(60):
        sim.advance(seconds / 60)
        found.append(total_energy(sim))
    return np.array(found) - found[0]


def test_energy_is_kept_driven_or_lost_as_the_method_has_it():
    scale = energies(RK4(), 5e-4)
    moving = 0.02  # J, what the cloth exchanges
    assert np.abs(scale).max() < 1e-6 * moving
    for method in REVERSIBLE:
        coarse, fine = (np.sqrt((energies(method, h) ** 2).mean()) for h in (2e-3, 1e-3))
        assert coarse < 0.05 * moving
        assert coarse / fine == pytest.approx(4.0, rel=0.15)
    assert energies(ExplicitEuler(), 1e-3)[-1] > moving
    lost = energies(Implicit(), 2e-2)
    assert lost[-1] < -1e-3 * moving
    assert lost.max() < 0.1 * moving
