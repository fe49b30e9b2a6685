"""Checks the step limit against closed forms, measured tables, the amplification matrix, and runs on both sides of it."""

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np
import pytest
import scipy.linalg

from flag_env.physics import Diverged, Lattice, Scene, Simulator, max_timestep, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, LinkEffect, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Leapfrog, Strang
from flag_env.physics.limits.certificate import MARGIN
from flag_env.physics.limits.spectrum import SceneSpectrum
from flag_env.physics.limits.step_limit import limited_by

DIRECTIONS = {  # independent of the effects' own lists
    Structural: [(0, 0, 1), (0, 1, 0)],
    Shear: [(0, 1, 1), (0, -1, 1)],
    Bending: [(0, 0, 2), (0, 2, 0)],
    CrossLayer: [(1, 0, 0), *((1, a, b) for a in (-1, 1) for b in (-1, 1))],
}


def just_below(sharp, digits=0.0):
    """What a proven limit may be: at most so much of itself below the sharp one as is left open, never above.

    `digits` is the relative error of a sharp limit that is known to some digits only.
    """
    return pytest.approx((1 - MARGIN) * sharp, rel=0.0, abs=(MARGIN + max(digits, 1e-9)) * sharp)


def chain(cols, **scene):
    return Scene(Lattice(1, 1, cols, 0.1, 0.01), (Structural(500.0, 0.0),), **scene)


# -- closed forms and tables -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("zeta", "known"), [(0.0, 2.0), (0.1, 1.8100), (0.5, 1.2361), (1.0, 0.8284), (10.0, 0.09975)])
def test_limit_of_one_oscillator(zeta, known):
    k, m = 350.0, 0.02
    scene = Scene(Lattice(1, 1, 2, 0.1, m), (Structural(k, 2 * zeta * math.sqrt(k * m)),))
    reduced = max_timestep(scene) * math.sqrt(k / m)
    assert reduced == pytest.approx(2 * (math.sqrt(1 + zeta**2) - zeta), rel=1e-9)
    assert reduced == pytest.approx(known, rel=5e-5)


def test_limit_of_damping_alone():
    lattice = Lattice(1, 1, 2, 0.1, 0.02)
    assert max_timestep(Scene(lattice, (AirDrag(8.0),))) == pytest.approx(2 / 8, rel=1e-9)
    assert max_timestep(Scene(lattice, (Structural(0.0, 0.4),))) == pytest.approx(2 * 0.02 / 0.4, rel=1e-9)
    assert max_timestep(Scene(lattice, (Structural(0.0, 0.4), AirDrag(8.0)))) == pytest.approx(2 / 28, rel=1e-9)


def test_nothing_limits_a_scene_without_links_and_damping():
    for scene in (
        Scene(Lattice(), (Gravity(), CosineWind())),
        presets.flag(1, 1),
        Scene(Lattice(1, 3, 3), (Structural(0.0, 0.0),)),
    ):
        assert max_timestep(scene) == math.inf
        assert 0 < Simulator(scene).timestep < math.inf


@pytest.mark.parametrize("cols", [2, 5, 40, 90])
def test_limit_of_a_chain(cols):
    free = cols - 1
    top = 2 * math.sqrt(500.0 / 0.01) * math.sin((2 * free - 1) * math.pi / (2 * (2 * free + 1)))  # clamped-free chain
    assert max_timestep(chain(cols)) == just_below(2 / top, 1e-9)


def measured(layers, taper, damped, **links):
    """The scene of the table of measured limits: damping is 2e-4 s times stiffness."""
    z = 2e-4 if damped else 0.0
    effects = (Structural(500.0, 500 * z, **links), Shear(250.0, 250 * z, **links), Bending(50.0, 50 * z, **links))
    return Scene(Lattice(layers, 20, 32, 0.05, 1e-3, taper), effects)


@pytest.mark.parametrize(
    ("taper", "damped", "undamped"), [(1.0, 7.972e-4, 9.769e-4), (0.1, 2.094e-4, 3.573e-4), (0.01, 3.054e-5, 1.147e-4)]
)
def test_limits_measured_for_one_layer(taper, damped, undamped):
    assert max_timestep(measured(1, taper, True)) == just_below(damped, 5e-4)  # four digits
    assert max_timestep(measured(1, taper, False)) == just_below(undamped, 5e-4)


@dataclass(frozen=True)
class Struts(LinkEffect):
    directions: ClassVar = ((1, 0, 0),)


@dataclass(frozen=True)
class CubeDiagonals(LinkEffect):
    directions: ClassVar = ((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1), (1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1))


def test_limits_measured_for_two_layers():
    """The table's second layer is joined by struts as stiff as structural links, face and space diagonals as stiff as shear."""
    damped = measured(2, 0.1, True).adding(Struts(500.0, 0.1), CubeDiagonals(250.0, 0.05))
    assert max_timestep(damped) == just_below(1.416e-4, 4e-4)
    assert max_timestep(damped.scaled(viscosity=0.0)) == just_below(2.770e-4, 2e-4)


def test_tapering_the_links_with_the_mass_costs_no_step():
    assert max_timestep(measured(1, 0.1, True, tapered=True)) == just_below(7.971e-4, 2e-4)


# -- the amplification matrix ------------------------------------------------------------------------------------------------


def random_scene(random, large=False):
    layers, rows, cols = (2, 5, 8) if large else (int(n) for n in random.integers((1, 1, 2), (3, 5, 6)))
    mass = 10 ** random.uniform(-3, 0)
    pinned = str(random.choice(["edge", "ends", "none"] if cols > 2 else ["edge", "none"]))
    lattice = Lattice(layers, rows, cols, 0.1, mass, random.uniform(0.05, 1.5), pinned)
    effects = []
    for kind in DIRECTIONS:
        if kind is Structural or random.random() < 0.7:
            k = mass * 10 ** random.uniform(3, 5)
            z = random.choice([0.0, random.uniform(0, 2) * math.sqrt(k * mass)])
            effects.append(kind(k, z, str(random.choice(["isotropic", "axial"])), tapered=bool(random.random() < 0.5)))
    if random.random() < 0.5:
        effects.append(AirDrag(random.uniform(0, 5)))
    return Scene(lattice, tuple(effects))


def spectral_radius(scene, h):
    """Of the linear scheme (w, x) -> (w', x + h w'), w' = (1 - h Z) w - h K x, links enumerated one by one."""
    lattice = scene.lattice
    number = {p: i for i, p in enumerate(product(*map(range, lattice.shape)))}
    share = np.array([1 - (1 - lattice.taper) * col / max(lattice.cols - 1, 1) for _, _, col in number])
    K, Z = np.zeros((2, len(number), len(number)))
    for effect in scene.effects:
        if isinstance(effect, AirDrag):
            Z += np.diag(effect.rate * lattice.mass * share)
            continue
        for (p, i), step in product(number.items(), DIRECTIONS[type(effect)]):
            j = number.get(tuple(np.add(p, step)))
            if j is not None:
                pair = np.zeros(len(number))
                pair[[i, j]] = 1, -1
                weight = (share[i] + share[j]) / 2 if effect.tapered else 1.0
                K += effect.stiffness * weight * np.outer(pair, pair)
                Z += effect.viscosity * weight * np.outer(pair, pair)
    last = lattice.cols - 1
    free = [
        i
        for (_, _, col), i in number.items()
        if lattice.pinned == "none" or (col > 0 and not (lattice.pinned == "ends" and col == last))
    ]
    mass = lattice.mass * share[free, None]
    K, Z = K[np.ix_(free, free)] / mass, Z[np.ix_(free, free)] / mass
    one = np.eye(len(free))
    matrix = np.block([[one - h * Z, -h * K], [h * (one - h * Z), one - h * h * K]])
    return np.abs(scipy.linalg.eigvals(matrix)).max()


@pytest.mark.parametrize("seed", range(14))
def test_limit_is_where_the_linear_scheme_starts_to_grow(seed):
    scene = random_scene(np.random.default_rng(seed), large=seed >= 12)
    limit = max_timestep(scene)
    assert spectral_radius(scene, limit) < 1 + 1e-7
    assert spectral_radius(scene, limit * (1 + 2.5 * MARGIN)) > 1 + 1e-7


@pytest.mark.parametrize(("rows", "cols"), [(2, 2), (3, 2), (3, 3), (2, 3), (1, 3), (4, 2)])
def test_directions_may_share_an_offset_on_narrow_lattices(rows, cols):
    scene = presets.flag(rows, cols).without(Gravity, CosineWind)
    limit = max_timestep(scene)
    assert spectral_radius(scene, limit) < 1 + 1e-7
    assert spectral_radius(scene, limit * (1 + 2.5 * MARGIN)) > 1 + 1e-7


# -- refusing and accepting --------------------------------------------------------------------------------------------------


def test_a_step_above_the_limit_is_refused_by_name():
    limit = max_timestep(chain(4))
    Simulator(chain(4, timestep=limit))
    scene = chain(4, timestep=1.001 * limit)
    with pytest.raises(ValueError, match="timestep must not exceed") as caught:
        Simulator(scene)
    assert f"{limit:.6g}" in str(caught.value)
    assert f"{1.001 * limit:.6g}" in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (Structural(3e4, 0.01), "the stiffness of Structural"),
        (Shear(3e4, 0.01), "the stiffness of Shear"),
        (Bending(10.0, 9.0), "the damping of Bending"),
        (AirDrag(1e5), "the damping of AirDrag"),
    ],
)
def test_a_refusal_names_what_sets_the_limit(changed, named):
    scene = presets.flag(4, 5).adding(changed)
    for method in (Leapfrog(), LFAB(), RK4(), ExplicitEuler()):
        one = scene.replace(integrator=method, timestep=2 * max_timestep(scene.replace(integrator=method)))
        if not (isinstance(method, ExplicitEuler) and "stiffness" not in named):
            with pytest.raises(ValueError, match=f"set by {named}.*lower {named}"):
                Simulator(one)


def test_a_refused_scaling_names_what_sets_the_limit():
    with pytest.raises(ValueError, match=r"set by the stiffness of Structural; scale it less"):
        Simulator(presets.flag(4, 5).scaled(viscosity=0.0)).set_parameters(30.0)


def test_what_sets_the_limit_has_the_largest_share_of_the_top_mode():
    """v' K_e v, from the eigenvector itself."""
    for seed in range(6):
        scene = random_scene(np.random.default_rng(seed)).replace(integrator=Strang())
        spectrum = SceneSpectrum(scene.lattice, scene.effects)
        values, vectors = np.linalg.eigh(spectrum.stiffness.toarray())
        shares = {}
        for effect in scene.effects:
            alone = SceneSpectrum(scene.lattice, (effect,)).stiffness.toarray()
            shares[f"the stiffness of {type(effect).__name__}"] = vectors[:, -1] @ alone @ vectors[:, -1]
        assert sum(shares.values()) == pytest.approx(values[-1], rel=1e-9)
        assert limited_by(scene) == max(shares, key=shares.get)


def test_an_undamped_scene_has_a_limit_for_every_method():
    """No damping at all on a lattice large enough for Lanczos."""
    scene = presets.flag(8, 10, viscosity=0.0, drag=0.0)
    explicit = max_timestep(scene.replace(integrator=Strang()))
    assert max_timestep(scene.replace(integrator=RK4())) == pytest.approx(math.sqrt(2) * explicit, rel=1e-9)


def test_automatic_step_is_nine_tenths_of_the_limit():
    scene = presets.flag(5, 6)
    assert Simulator(scene).timestep == pytest.approx(0.9 * max_timestep(scene), rel=1e-15)


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


# -- runs on both sides ------------------------------------------------------------------------------------------------------


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
