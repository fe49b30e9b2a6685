"""Runs on both sides of the step limit: whole below, growing just above, and divergence told exactly."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flag_env.physics import Diverged, Lattice, Scene, Simulator, max_timestep
from flag_env.physics.effects import Bending, CosineWind, CrossLayer, Gravity, Shear, Structural
from tests.physics.test_stability import chain


def test_divergence_is_seen_soon_and_told_exactly():
    scene = chain(4, timestep=1.5 * max_timestep(chain(4)), allow_unstable=True)
    start = scene.lattice.rest_positions * 1.01
    sim, watched = Simulator(scene), Simulator(scene)
    sim.set_positions(start)
    watched.set_positions(start)
    with pytest.raises(Diverged) as caught:
        sim.step(100_000)
    first = None
    while first is None:
        try:
            watched.step(1)
        except Diverged as seen:
            first = seen
    error = caught.value
    assert isinstance(error, FloatingPointError)
    late = (error.time - first.time) / sim.timestep
    assert -1e-6 < late <= 100
    assert first.time == pytest.approx(watched.time, rel=1e-12)
    assert error.copy == 0
    bad = ~np.isfinite(watched.positions[0] + watched.velocities[0]).all(axis=-1)
    assert bad[first.particle]
    for word in ("copy 0", str(error.particle), f"{error.time:.6g}"):
        assert word in str(error)
    assert sim.diverged.tolist() == [True]


def scaled_wind(wind, factor):
    return replace(wind, amplitude=factor * np.array(wind.amplitude), mean=factor * np.array(wind.mean))


@pytest.mark.parametrize("damping", ["none", "isotropic", "axial"])
def test_just_below_the_limit_a_flag_in_wind_stays_whole(damping):
    random = np.random.default_rng(["none", "isotropic", "axial"].index(damping))
    for _ in range(7):
        layers, rows, cols = (int(n) for n in random.integers((1, 2, 2), (3, 6, 8)))
        mass, taper, tapered = 0.01, random.uniform(0.05, 1.0), bool(random.random() < 0.5)
        effects = []
        for kind in (Structural, Shear, Bending, CrossLayer):
            k = mass * 10 ** random.uniform(3.5, 4.5)
            z = 0.0 if damping == "none" else 10 ** random.uniform(-2, 0.3) * math.sqrt(k * mass)
            effects.append(kind(k, z, "axial" if damping == "axial" else "isotropic", tapered=tapered))
        push = mass * taper * random.uniform(-60, 60, 3)
        wind = CosineWind(tuple(push), tuple(random.uniform(1, 30, 3)), tuple(push[::-1] / 3))
        scene = Scene(Lattice(layers, rows, cols, 0.1, mass, taper), (Gravity(), *effects, wind), perturbation=1e-3)
        sim = Simulator(scene.replace(timestep=0.95 * max_timestep(scene)))
        sim.advance(2.0)
        if damping == "none":
            # Finite is all that holds without damping: whipped this hard, a flag may gain energy from the step near the limit.
            assert np.isfinite(sim.positions).all()
            assert np.isfinite(sim.velocities).all()
            sim = Simulator(scene.adding(scaled_wind(wind, 0.25)).replace(timestep=0.95 * max_timestep(scene)))
            sim.advance(2.0)
        x = sim.positions[0]
        assert np.linalg.norm(np.diff(x, axis=2), axis=-1).max() < (0.15 if damping == "none" else 0.3)
        assert np.abs(x[:, :, 1:] - scene.lattice.rest_positions[:, :, 1:]).max() > 5e-4


@pytest.mark.parametrize("viscosity", [0.0, 0.5])
def test_small_oscillations_grow_just_above_the_limit_and_not_below(viscosity):
    """Along a chain a spring is as stiff as the limit assumes, so growth starts at the limit itself."""
    scene = Scene(Lattice(1, 1, 6, 0.1, 0.01), (Structural(500.0, viscosity),), allow_unstable=True)
    rest = scene.lattice.rest_positions
    start = rest.copy()
    start[0, 0, 1:, 0] += 1e-12 * np.random.default_rng(0).standard_normal(5)

    def growth(factor, steps):
        sim = Simulator(scene.replace(timestep=factor * max_timestep(scene)))
        sim.set_positions(start)
        sim.step(steps)
        return np.abs(sim.positions - rest).max() / 1e-12

    assert growth(0.99, 2000) < 10
    assert growth(1.01, 400) > 1e3
    assert growth(1.3, 20) > 1e4
    with pytest.raises(Diverged):
        growth(1.3, 5000)
