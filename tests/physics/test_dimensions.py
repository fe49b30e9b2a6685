"""The rope in one coordinate and the sheet in two, against other ways to compute them."""

import numpy as np
import pytest

from flag_env.physics import Scene, Simulator, effects, presets
from flag_env.physics.integrators import Leapfrog
from flag_env.physics.lattice import Lattice


@pytest.mark.parametrize("pinned", ["ends", "edge"])
@pytest.mark.parametrize(("stiffness", "viscosity"), [(0.1e6, 0.01e3), (0.1e6, 0.0), (0.05e6, 0.3e3)])
def test_rope_is_the_matrix_recurrence(pinned, stiffness, viscosity):
    """X_{n+1} = (2I - Z - K) X_n + (Z - I) X_{n-1}, with dense matrices in extended precision, over 10 000 steps."""
    cols, step = 16, 1e-3
    scene = presets.rope(cols, pinned=pinned, effects=(effects.Structural(stiffness, viscosity),))
    simulator = Simulator(scene)
    graph = np.zeros((cols, cols))
    for i in range(cols - 1):
        graph[np.ix_([i, i + 1], [i, i + 1])] += [[1, -1], [-1, 1]]
    free = slice(1, -1) if pinned == "ends" else slice(1, None)
    graph = graph[free, free].astype(np.longdouble)
    identity = np.eye(len(graph), dtype=np.longdouble)
    K, Z = step**2 * stiffness * graph, step * viscosity * graph
    start = scene.lattice.rest_positions.copy()
    start[0, 0, free, 2] = np.random.default_rng(1).standard_normal(len(graph))
    simulator.set_positions(start)
    before = now = start[0, 0, free, 2].astype(np.longdouble)
    for n in range(10_000):
        now, before = (2 * identity - Z - K) @ now + (Z - identity) @ before, now
        simulator.step()
        if n % 500 == 0 or n == 9_999:
            np.testing.assert_allclose(simulator.positions[0, 0, 0, free, 2], now.astype(float), rtol=0, atol=1e-12)


def test_rope_moves_along_z_only():
    scene = presets.rope(10)
    simulator = Simulator(scene)
    positions = scene.lattice.rest_positions.copy()
    positions[0, 0, 4, 2] = 0.5
    simulator.set_positions(positions)
    simulator.step(100)
    assert np.array_equal(simulator.positions[0, ..., :2], scene.lattice.rest_positions[..., :2])
    assert not simulator.velocities[..., :2].any()
    positions[0, 0, 4, 0] += 0.1
    with pytest.raises(ValueError, match="positions must keep x and y as at rest: the scene has dimensions=1"):
        simulator.set_positions(positions)


@pytest.mark.parametrize("damping", ["isotropic", "axial"])
@pytest.mark.parametrize("viscosity", [0.0, 0.02])
def test_sheet_is_the_flag_that_stays_in_its_plane(damping, viscosity):
    """A plane flag without a push out of its plane: three coordinates and two give the same bits."""
    sheet = presets.sheet(6, 9)
    changed = [effects.Structural(300.0, viscosity, damping, True), effects.Bending(6.0, viscosity, damping, True)]
    sheet = sheet.adding(*changed)
    flag = sheet.replace(lattice=presets.flag(6, 9).lattice, perturbation=0.0)
    runs = [Simulator(scene) for scene in (sheet, flag)]
    for simulator in runs:
        simulator.set_wind(amplitude=(0.02, 0.0, 0.01), frequency=(1.0, 0.0, 3.0))
        simulator.set_mast(position=(0.1, 0.0, 0.2), tilt=(0.0, 0.3))
        simulator.advance(1.0)
    assert np.array_equal(runs[0].positions, runs[1].positions)
    assert np.array_equal(runs[0].velocities, runs[1].velocities)
    for name, energy in runs[0].energy().items():
        np.testing.assert_allclose(energy, runs[1].energy()[name], rtol=1e-13)


@pytest.mark.parametrize("scene", [presets.rope(8), presets.sheet(4, 5)], ids=["rope", "sheet"])
def test_conservative_forces_are_minus_the_gradient_of_the_energy(scene):
    """By central differences, coordinate by coordinate."""
    scene = scene.without(effects.AirDrag, effects.CosineWind).scaled(viscosity=0.0)
    lattice = scene.lattice
    rng = np.random.default_rng(0)
    positions = lattice.rest_positions.copy()
    positions[..., list(lattice.axes)] += 0.02 * rng.standard_normal((*lattice.shape, lattice.dimensions))
    step = 1e-5
    simulator = Simulator(scene.replace(timestep=step, integrator=Leapfrog()))
    simulator.set_positions(positions)
    simulator.step(1)
    force = lattice.masses * (simulator.positions[0] - positions).reshape(-1, 3).T / step**2

    def energy(flat):
        return sum(float(effect.energy(lattice, flat.reshape(1, -1, 3))[0]) for effect in scene.effects)

    flat = positions.reshape(-1, 3)
    for particle in np.flatnonzero(~lattice.fixed):
        for axis in lattice.axes:
            shift = np.zeros_like(flat)
            shift[particle, axis] = 1e-6
            slope = (energy(flat + shift) - energy(flat - shift)) / 2e-6
            assert force[axis, particle] == pytest.approx(-slope, abs=2e-5 * np.abs(force).max())


@pytest.mark.parametrize(("dimensions", "coordinates"), [(1, 1), (2, 2), (3, 3)])
def test_state_holds_no_coordinate_too_many(dimensions, coordinates):
    lattice = Lattice(1, 4, 5, dimensions=dimensions)
    state = Simulator(Scene(lattice, (effects.Structural(),)), copies=2).get_state()
    assert state.positions.shape == state.velocities.shape == (2, coordinates, 20)


def test_dimensions_are_checked():
    with pytest.raises(ValueError, match="dimensions must be 1, 2 or 3, got 4"):
        Lattice(dimensions=4)
    with pytest.raises(ValueError, match="layers must be 1 with dimensions=2, got 2"):
        Lattice(layers=2, dimensions=2)
