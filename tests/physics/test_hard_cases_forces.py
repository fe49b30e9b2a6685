"""The README's hard cases of force: stiff and viscous links, tips of little mass, strong and resonant wind."""

import math

import numpy as np
import pytest

from flag_env.physics import Diverged, Lattice, Simulator, diagnostics, max_timestep, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, Gravity, LinkEffect, Shear, Structural
from flag_env.physics.integrators import LFAB, Leapfrog, Strang

# Each hard case has a short form, in the files of hard cases or in those of its subject; the long forms run under `-m slow`.
# All scenes but the lattices without links have the classes of `flag`, so that few steps are compiled.
slow = pytest.mark.slow


def long_form(name, short, long):
    """A parameter with a value for every run and one for the long forms."""
    return pytest.mark.parametrize(name, [short, pytest.param(long, marks=slow)])


def strains(sim):
    return diagnostics.strain(sim.scene.lattice, sim.positions)


def whole(sim, largest):
    """All numbers finite, no link longer than 1 + `largest` times its rest length."""
    assert np.isfinite(sim.velocities).all()
    assert strains(sim).max() < largest


def forced(scene, acceleration, frequency=(3.0, 5.0, 7.0)):
    push = scene.lattice.masses.mean() * np.asarray(acceleration, float)
    return scene.adding(CosineWind(tuple(push), frequency, tuple(0.5 * push)))


# -- stiffness and viscosity -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("stiffness", "viscosity"), [(100.0, 1.0), (1e4, 1.0), (1.0, 1000.0), (100.0, 1000.0)])
@long_form("steps", 20_000, 500_000)
def test_extreme_links_take_an_automatic_step_and_stay_whole(stiffness, viscosity, steps, record_property):
    flag = presets.flag(6, 7)
    scene = forced(flag.scaled(stiffness, viscosity), (5.0, 8.0, 3.0))
    sim = Simulator(scene)
    share = sim.timestep / max_timestep(scene)
    assert share == pytest.approx(0.9, rel=1e-12) or share == pytest.approx(0.5, rel=1e-12)  # undamped stiffness takes half
    if viscosity == 1.0:  # where stiffness rules, the limit falls with its root
        ratio = max_timestep(flag.scaled(1.0, 0.0).without(AirDrag)) / max_timestep(flag.scaled(stiffness, 0.0).without(AirDrag))
        assert ratio == pytest.approx(math.sqrt(stiffness), rel=1e-6)
    else:  # where viscosity rules, with its inverse
        more = max_timestep(scene.scaled(1.0, 2.0))
        assert max_timestep(scene) / more == pytest.approx(2.0, rel=2e-2)
    sim.step(steps)
    whole(sim, 1.0)
    record_property("strain at the end", float(strains(sim).max()))
    above = Simulator(scene.replace(timestep=1.35 * max_timestep(scene), allow_unstable=True))
    above.set_velocities(np.where(scene.lattice.fixed.reshape(1, 6, 7, 1), 0.0, above.positions[0] * 0.0 + 0.1))
    try:
        above.step(20_000)
        grown = strains(above).max()
    except Diverged:
        grown = math.inf
    assert grown > 1.0


@pytest.mark.parametrize("taper", [0.01, 0.001])
@long_form("seconds", 10.0, 100.0)
def test_a_tip_of_little_mass(taper, seconds, record_property):
    scene = forced(presets.flag(6, 7, taper=taper), (5.0, 8.0, 3.0))
    sim = Simulator(scene)
    sim.advance(seconds)
    whole(sim, 1.0)
    record_property("strain at the end", float(strains(sim).max()))
    assert np.abs(sim.positions[0, 0, :, -1] - scene.lattice.rest_positions[0, :, -1]).max() > 0.1  # the tip moves


# -- wind --------------------------------------------------------------------------------------------------------------------


@long_form("seconds", 10.0, 100.0)
def test_wind_of_fifty_weights(seconds, record_property):
    sim = Simulator(forced(presets.flag(6, 7), 50 * 9.81 * np.array([0.5, 0.7, 0.5])))
    largest = 0.0
    for _ in range(round(10 * seconds)):
        sim.advance(0.1)
        largest = max(largest, strains(sim).max())
    whole(sim, 20.0)
    record_property("largest strain", float(largest))
    assert 0.1 < largest < 20.0


@pytest.mark.parametrize("method", [Leapfrog(), LFAB(), Strang()], ids=repr)
@long_form("steps", 50, 500)
def test_resonance_has_the_amplitude_of_the_linear_theory(method, steps, record_property):
    """One particle on a spring, driven along it at its own frequency w: amplitude F / (c w)."""
    mass, k, rate, push = 0.02, 40.0, 0.6, 1e-3
    w = math.sqrt(k / mass)
    wind = CosineWind((push, 0.0, 0.0), (w, 0.0, 0.0))
    links = Structural(k, 0.0), Shear(k, 0.0), Bending(k, 0.0)
    scene = presets.flag(6, 7).replace(
        lattice=Lattice(1, 1, 2, 0.5, mass),
        effects=(Gravity(0.0), *links, AirDrag(rate), wind),
        integrator=method,
        perturbation=0.0,
    )
    sim = Simulator(scene.replace(timestep=1.0 / steps / w))
    sim.advance(12 / rate)
    reach = [sim.positions[0, 0, 0, 1, 0] - 0.5 for _ in range(14 * steps) if sim.step(1) is None]
    record_property("amplitude / (F / (c w))", float(max(reach) / (push / (rate * mass * w))))
    assert max(reach) == pytest.approx(push / (rate * mass * w), rel=0.05)


def plane_stiffness(scene):
    """Stiffness of the flag at rest against small motions of its free particles along x and z: sum of k n n' over the links."""
    lattice = scene.lattice
    rest = lattice.rest_positions.reshape(-1, 3)[:, [0, 2]]
    K = np.zeros((lattice.size, 2, lattice.size, 2))
    for effect in scene.effects:
        for family in effect.families(lattice) if isinstance(effect, LinkEffect) else ():
            for i in np.flatnonzero(family.present):
                j = i + family.offset
                n = (rest[j] - rest[i]) / np.linalg.norm(rest[j] - rest[i])
                for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                    K[a, :, b, :] += sign * effect.stiffness * np.outer(n, n)
    free = ~lattice.fixed
    return K[free][:, :, free].reshape(2 * free.sum(), -1)


def test_wind_at_the_first_natural_frequency_of_a_flag(record_property):
    """Small swaying in its plane: the first mode's amplitude is that of the linear theory, F / (c w) in its own coordinate."""
    flag = presets.flag(4, 6, taper=1.0, perturbation=0.0, integrator=LFAB())
    still = Gravity(0.0), Structural(300.0, 0.0), Shear(75.0, 0.0), Bending(6.0, 0.0)
    mass, force = flag.lattice.mass, 1e-7
    squares, modes = np.linalg.eigh(plane_stiffness(flag.replace(effects=still)) / mass)
    w, mode = math.sqrt(squares[0]), modes[:, 0].reshape(-1, 2)
    rate = w / 50
    expected = abs(force * mode[:, 1].sum() * mode[-1, 1]) / (mass * rate * w)
    wind = CosineWind((0.0, 0.0, force), (0.0, 0.0, w))
    sim = Simulator(flag.replace(effects=(*still, AirDrag(rate), wind), timestep=0.02 / w))
    sim.advance(12 / rate)
    height = flag.lattice.rest_positions[0, -1, -1, 2]
    reach = max(sim.positions[0, 0, -1, -1, 2] - height for _ in range(350) if sim.step(1) is None)
    record_property("amplitude / (F / (c w))", float(reach / expected))
    assert reach == pytest.approx(expected, rel=0.05)
