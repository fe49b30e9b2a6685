"""Energy does not rise without a source: thrown cloth at the automatic step, crumpled cloth at large implicit steps."""

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, effects, integrators, max_timestep, presets
from flag_env.physics.effects import AirDrag, CosineWind, Gravity, Structural

METHODS = (integrators.Leapfrog(), integrators.LFAB(), integrators.Strang(), integrators.RK4())


def alone(rows=8, cols=12, viscosity=0.0, **options):
    """A flag that nothing drives."""
    return presets.flag(rows, cols, viscosity=viscosity, drag=0.0, **options).without(Gravity, CosineWind)


def energy(sim):
    return sum(sim.energy().values())


def worst_rise(scene, steps, speed, copies=4, seed=0, looks=20):
    """Largest E/E0 of thrown copies at any of the looks."""
    sim = Simulator(scene, copies=copies)
    random = np.random.default_rng(seed)
    sim.set_velocities(speed * random.standard_normal(sim.positions.shape))
    start, worst = energy(sim), 0.0
    for _ in range(looks):
        sim.step(steps // looks)
        worst = max(worst, (energy(sim) / start).max())
    return worst


@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize("viscosity", [0.0, 3e-4, 3e-3, 0.02])
def test_thrown_cloth_does_not_heat_at_the_automatic_step(method, viscosity):
    """At 0.9 of the limit undamped leapfrog brings 0.92, 3e4 and 1e6 times the energy after 1e3, 1e4 and 1e5 steps."""
    assert worst_rise(alone(viscosity=viscosity).replace(integrator=method), 20_000, 5.0) < 1.1


def test_the_automatic_step_is_shorter_only_where_stiffness_is_undamped():
    shares = {}
    for name, scene in {
        "undamped": alone(),
        "a little drag": presets.flag(8, 12, viscosity=0.0, drag=0.3),
        "axial": alone().adding(Structural(300.0, 0.02, "axial")),
        "flag": presets.flag(8, 12),
        "storm": presets.storm_flag(8, 12),
        "two layers": presets.two_layer_flag(8, 12),
    }.items():
        for method in METHODS:
            tried = scene.replace(integrator=method, timestep="auto")
            shares[name, type(method).__name__] = Simulator(tried).timestep / max_timestep(tried)
    for (name, method), share in shares.items():
        damped = name in ("flag", "storm", "two layers") or method == "RK4"
        assert share == pytest.approx(0.9 if damped else 0.5, rel=1e-9), (name, method)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize("viscosity", [0.0, 3e-4, 0.02])
@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_thrown_cloth_does_not_heat_in_a_million_steps(method, viscosity, speed):
    assert worst_rise(alone(viscosity=viscosity).replace(integrator=method), 1_000_000, speed) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("number", range(40))
def test_random_thrown_scenes_do_not_heat(number):
    random = np.random.default_rng((7, number))
    rows, cols = random.integers(3, 9, 2)
    kinds = (effects.Structural, effects.Shear, effects.Bending)
    links = tuple(
        kind(
            10 ** random.uniform(0, 3),
            random.choice([0.0, 10 ** random.uniform(-5, -2)]),
            str(random.choice(["isotropic", "axial"])),
        )
        for kind in kinds
    )
    lattice = Lattice(1, int(rows), int(cols), tuple(random.uniform(0.03, 0.1, 2)), taper=random.uniform(0.2, 1.0))
    scene = Scene(lattice, links, METHODS[number % 4])
    assert worst_rise(scene, 100_000, random.uniform(0.5, 5.0), seed=number) < 1.25


def test_implicit_does_not_ring_between_two_states():
    """Two particles on a damped spring, far above the explicit limit: only the flight of their centre is left in the end."""
    lattice = Lattice(1, 1, 2, 0.05, pinned="none")
    sim = Simulator(Scene(lattice, (Structural(500.0, 0.05),), integrators.Implicit(), timestep=0.0566, allow_unstable=True))
    sim.set_velocities(np.array([[[[0.0, 0.0, 0.0], [1.0, 6.0, 0.0]]]]))
    start = energy(sim)[0]
    for _ in range(200):
        sim.step(1)
        assert energy(sim)[0] <= start * (1 + 1e-9)
    centre = 0.5 * 2e-3 * (0.5**2 + 3.0**2)
    assert energy(sim)[0] == pytest.approx(centre, rel=1e-6)


@pytest.mark.parametrize("viscosity", [0.0, 5e-4, 5e-3, 0.02])
def test_implicit_loses_energy_up_to_its_limit(viscosity):
    scene = alone(viscosity=viscosity).replace(integrator=integrators.Implicit())
    limit = max_timestep(scene)
    explicit = max_timestep(scene.scaled(viscosity=0.0).replace(integrator=integrators.Leapfrog()))
    assert limit >= 9.9 * explicit
    for timestep in (0.3 * limit, limit):
        for crumple, speed in ((0.05, 1.0), (0.0, 5.0)):
            sim = Simulator(scene.replace(timestep=timestep), copies=2)
            random = np.random.default_rng(0)
            sim.set_positions((0.3 if crumple else 1.0) * sim.positions + crumple * random.standard_normal(sim.positions.shape))
            sim.set_velocities(speed * random.standard_normal(sim.positions.shape))
            start = energy(sim)
            for _ in range(10):
                sim.step(30)
                assert (energy(sim) <= 1.001 * start).all()


def test_crumpled_cloth_comes_to_rest():
    """An 8 x 12 flag, crumpled, in still air at h = 0.01: the motion dies, and what energy is left is that of a fold."""
    scene = presets.flag(8, 12).without(Gravity, CosineWind).replace(integrator=integrators.Implicit(), timestep=0.01)
    assert any(isinstance(effect, AirDrag) for effect in scene.effects)
    sim = Simulator(scene)
    random = np.random.default_rng(0)
    sim.set_positions(0.3 * sim.positions + 0.05 * random.standard_normal(sim.positions.shape))
    start = energy(sim)[0]
    sim.advance(60.0)
    assert sim.energy()["kinetic"][0] < 1e-9 * start
