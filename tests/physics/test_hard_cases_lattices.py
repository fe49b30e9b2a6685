"""The README's hard cases of lattices: the smallest and a large one; no access out of bounds."""

import numpy as np
import pytest

from flag_env.physics import Simulator, presets
from flag_env.physics.effects import LinkEffect
from tests.physics.test_hard_cases_forces import slow


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_small_lattices_hang_or_fall_as_statics_has_it(rows, cols):
    scene = presets.flag(rows, cols, drag=3.0, viscosity=0.2, perturbation=0.0)
    sim = Simulator(scene)
    sim.advance(30.0)
    x = sim.positions[0, 0]
    if cols == 1:  # all is pinned
        np.testing.assert_array_equal(x, scene.lattice.rest_positions[0])
        return
    free = scene.lattice.masses.reshape(rows, cols)[:, 1:].sum()
    pull = -sum(  # the force of the links on the mast's column bears the weight
        gradient(effect, scene.lattice, sim.positions) for effect in scene.effects if isinstance(effect, LinkEffect)
    )
    assert pull == pytest.approx(-9.81 * free, rel=1e-6)


def gradient(effect, lattice, positions):
    """Derivative of the energy by the height of the mast's column."""
    up = np.zeros_like(positions)
    up[:, :, :, 0, 2] = 1e-6
    energies = [effect.energy(lattice, (positions + sign * up).reshape(1, -1, 3))[0] for sign in (1, -1)]
    return (energies[0] - energies[1]) / 2e-6


@slow
def test_a_large_lattice():
    scene = presets.flag(512, 512, dtype="float32", timestep=5e-6)
    sim = Simulator(scene)
    sim.step(20)
    assert np.isfinite(sim.positions).all()
    middle = sim.velocities[0, 0, 256, 256, 2]  # as yet the weight alone moves it
    assert middle == pytest.approx(-9.81 * sim.time, rel=0.02)


@slow
def test_no_effect_nor_integrator_leaves_its_arrays(run_python, tmp_path):
    """Numba's own bounds checks, on the lattices where offsets leave the array first."""
    script = """
import itertools
import numpy as np
from flag_env.physics import Lattice, Scene, Simulator, effects as e, integrators as i
every = (
    e.Gravity(), e.Structural(50.0, 0.01), e.Shear(20.0, 0.01, "axial"), e.Bending(5.0, 0.0), e.CrossLayer(20.0, 0.01),
    e.AirDrag(), e.CosineWind((0.1, 0.1, 0.1)), e.SelfCollision(), e.MastCollision(), e.StrainLimit(), e.Tearing(0.5),
)
air = e.AirPressure(gusts=e.Gusts(1.0))  # of another unit than the cosine wind
count = 0
for layers, (rows, cols) in itertools.product((1, 2), ((1, 1), (1, 6), (6, 1), (2, 2), (4, 5))):
    lattice = Lattice(layers, rows, cols, 0.1, 0.01, 0.3)
    fitting = every if rows > 1 else every[:8] + every[9:]  # one pinned particle makes no pole to collide with
    scene = Scene(lattice, fitting, i.Leapfrog(), timestep=1e-4, perturbation=1e-3)
    for one in (scene, scene.without(e.CosineWind).adding(air)) if layers == 1 and min(rows, cols) > 1 else (scene,):
        sim = Simulator(one, copies=2)
        sim.step(30)
        assert np.isfinite(sim.positions).all()
    count += 1
for method in (i.ExplicitEuler(), i.LFAB(), i.Strang(), i.RK4(), i.Implicit()):
    for rows, cols in ((1, 2), (2, 2), (4, 5)):
        scene = Scene(Lattice(1, rows, cols, 0.1, 0.01), (every[0], every[1], e.AirDrag()), method, timestep=1e-4)
        sim = Simulator(scene)
        sim.step(30)
        sim.velocities
        count += 1
from numba import config
print(config.BOUNDSCHECK, count)
"""
    told = run_python(script, NUMBA_BOUNDSCHECK="1", NUMBA_CACHE_DIR=str(tmp_path))
    assert told.split() == ["1", "25"]  # all lattices, with every effect and integrator
