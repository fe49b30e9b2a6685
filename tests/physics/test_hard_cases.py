"""The README's table of hard cases: a short form of each here and in the files of its subject, the long forms under `-m slow`.

All scenes but the lattices without links have the classes of `flag`, so that few steps are compiled.
"""

import itertools
import math

import numpy as np
import pytest
import scipy.stats

from flag_env.physics import Diverged, Lattice, Simulator, diagnostics, max_timestep, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, Gravity, LinkEffect, Shear, Structural
from flag_env.physics.integrators import LFAB, Leapfrog, Strang
from flag_env.studies import margins

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


# -- poses -------------------------------------------------------------------------------------------------------------------


def settle(sim, rest, seconds=20.0):
    """Let the flag hang calm and compare it with one that was never disturbed."""
    sim.advance(seconds)
    whole(sim, 0.5)
    return np.sqrt(((sim.positions - rest) ** 2).sum(axis=-1).mean()) / sim.scene.lattice.diagonal


def calm(layers):
    scene = (presets.flag if layers == 1 else presets.two_layer_flag)(5, 6, viscosity=0.1, drag=3.0)
    return scene.adding(CosineWind(mean=tuple(4.0 * scene.lattice.masses.mean() * np.array([2.0, 0.0, 1.0]))))


POSES = {
    "coincident": lambda x: np.where(np.arange(x.shape[2])[:, None] > 0, 1e-9 * x + x[:, :, :1], x),
    "folded": lambda x: np.where(x[..., :1] > 0.75, x * [-1, 1, 1] + [1.5, 1e-4, 0], x),
    "turned over": lambda x: x * [-1, 1, 1],
    "crumpled": lambda x: np.where(
        np.arange(x.shape[2])[:, None] > 0, x[:, :, :1] + 0.02 * np.random.default_rng(0).standard_normal(x.shape), x
    ),
}


@pytest.mark.parametrize("pose", POSES)
@long_form("seconds", 20.0, 100.0)
def test_a_flag_recovers_from(pose, seconds, record_property):
    scene = calm(1)
    undisturbed, sim = Simulator(scene), Simulator(scene)
    undisturbed.advance(seconds)
    x = POSES[pose](scene.lattice.rest_positions)
    x[:, :, 1:, 1] += 1e-3 * np.random.default_rng(0).standard_normal(x[:, :, 1:, 1].shape)  # what is plane stays plane
    sim.set_positions(x)
    apart = settle(sim, undisturbed.positions, seconds)
    record_property("RMS distance to one never disturbed / diagonal", float(apart))
    assert apart < 0.1


@pytest.mark.parametrize("pose", ["squeezed", "swapped"])
@long_form("seconds", 20.0, 100.0)
def test_two_layers_recover_from_being(pose, seconds, record_property):
    scene = calm(2)
    sim = Simulator(scene)
    x = scene.lattice.rest_positions.copy()
    x[:, :, 1:, 1] = 1e-7 * x[:, :, 1:, 1] if pose == "squeezed" else x[::-1, :, 1:, 1]
    sim.set_positions(x)
    sim.advance(seconds)
    whole(sim, 0.5)
    gap = np.linalg.norm(sim.positions[0, 1] - sim.positions[0, 0], axis=-1)
    across = scene.lattice.spacings[2]
    record_property("distance of the layers / thickness", [float(gap[:, 1:].min() / across), float(gap[:, 1:].max() / across)])
    assert gap[:, 1:].min() > 0.3 * across  # apart again, whichever side they are on
    assert gap[:, 1:].max() < 1.7 * across


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@long_form("seconds", 2.0, 100.0)
def test_links_of_no_length(dtype, seconds):
    scene = presets.flag(5, 6, dtype=dtype)
    sim = Simulator(scene.replace(lattice=Lattice(1, 5, 6, 1e-30 if dtype == "float64" else 1e-15, 0.01, 0.1), perturbation=0.0))
    sim.advance(seconds)
    assert np.isfinite(sim.positions).all()
    assert np.isfinite(sim.velocities).all()


# -- the mast ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [Leapfrog(), LFAB()], ids=repr)
@long_form("seconds", 25.0, 100.0)
def test_a_mast_teleported_by_ten_flags_gets_its_flag_back(method, seconds, record_property):
    scene = calm(1).replace(integrator=method)
    undisturbed, sim = Simulator(scene), Simulator(scene)
    undisturbed.advance(seconds)
    far = np.array([0.0, 15.0, 0.0])
    sim.set_mast(far)
    sim.advance(0.04)
    assert strains(sim).max() > 1.0
    assert np.isfinite(sim.velocities).all()
    record_property("strain after the jump", float(strains(sim).max()))
    apart = settle(sim, undisturbed.positions + far, seconds)
    record_property("RMS distance to one never disturbed / diagonal", float(apart))
    assert apart < 0.1


@long_form("seconds", 5.0, 100.0)
def test_a_mast_shaken_at_twenty_hertz(seconds, record_property):
    scene = calm(1)
    undisturbed, sim = Simulator(scene), Simulator(scene)
    undisturbed.advance(25.0)
    largest = 0.0
    for n in range(1, round(80 * seconds) + 1):  # 4 places a period
        sim.set_mast((0.05 * math.sin(math.pi / 2 * n), 0.05 * math.cos(math.pi / 2 * n), 0.0))
        sim.advance(0.0125)
        largest = max(largest, strains(sim).max())
    assert 0.0 < largest < 5.0
    sim.set_mast()
    apart = settle(sim, undisturbed.positions, 25.0)
    record_property("largest strain", float(largest))
    record_property("RMS distance to one never disturbed / diagonal", float(apart))
    assert apart < 0.1


# -- long runs ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.25, 0.5, 0.9])
@pytest.mark.parametrize("steps", [50_000, pytest.param(1_000_000, marks=slow)])
def test_energy_does_not_drift_without_damping(share, steps, record_property):
    """Flags that swing freely: means of ten blocks, lines through them, the bootstrap interval of the flags' mean slope."""
    scene = presets.flag(4, 5, viscosity=1e-99, drag=0.0, integrator=LFAB()).adding(CosineWind())
    timestep = float(f"{share * max_timestep(scene):.6g}")  # the same on every machine, whatever its last bits of a limit
    sim = Simulator(scene.replace(timestep=timestep), copies=32)
    sim.advance(100.0)  # past the fall, whose energy is not yet spread over the modes
    blocks = []
    for _ in range(10):
        samples = []
        for _ in range(200):
            sim.step(steps // 2000)
            samples.append(sum(sim.energy().values()))
        blocks.append(np.mean(samples, axis=0))
    heights = np.array(blocks) / scene.lattice.masses.sum() / 9.81  # m, (blocks, copies)
    slopes = np.polyfit(np.arange(10), heights, 1)[0]
    random = np.random.default_rng(0)
    low, high = np.quantile(slopes[random.integers(0, 32, (20_000, 32))].mean(axis=1), [0.0005, 0.9995])
    record_property("slope interval [m per block]", [float(low), float(high)])
    record_property("drift over the run [m]", float(9 * slopes.mean()))
    assert low <= 0.0 <= high
    assert abs(9 * slopes.mean()) < 1e-3  # of flags that swing over about a metre


@pytest.mark.parametrize("steps", [100_000, pytest.param(10_000_000, marks=slow)])
def test_statistics_of_both_precisions_agree(steps, record_property):
    """Damped and in wind: time means of tip height and largest strain, with block standard errors."""
    means, errors = [], []
    for dtype in ("float64", "float32"):
        sim = Simulator(forced(presets.flag(6, 7, dtype=dtype), (6.0, 9.0, 5.0)))
        sim.advance(5.0)
        samples = []
        for _ in range(1000):
            sim.step(steps // 1000)
            samples.append((sim.positions[0, 0, :, -1, 2].mean(), sim.positions[0, 0, :, -1, 0].mean(), strains(sim).max()))
        whole(sim, 1.0)
        blocks = np.array(samples).reshape(20, 50, 3).mean(axis=1)
        means.append(blocks.mean(axis=0))
        errors.append(blocks.std(axis=0, ddof=1) / math.sqrt(20))
    difference, error = np.abs(means[0] - means[1]), np.hypot(*errors)
    record_property("tip height, tip reach [m], strain: float64", means[0].tolist())
    record_property("difference in float32", difference.tolist())
    record_property("standard error", error.tolist())
    assert (difference < scipy.stats.t.ppf(0.9995, 38) * error + 1e-4).all()


# -- the limit ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "scenes"),
    [
        *((method, 6) for method in (Leapfrog(), LFAB(), Strang())),
        *(pytest.param(method, 300, marks=slow) for method in margins.METHODS),
    ],
    ids=str,
)
def test_no_random_flag_blows_up_below_its_limit(method, scenes, record_property):
    found = margins.margins(method, scenes)
    for name, value in found.items():
        record_property(name, value)
    assert found["blow-ups at 0.95"] == 0
    assert found["blow-up, least"] >= 1.0
    assert found["median"] < 1.35


# -- lattices ----------------------------------------------------------------------------------------------------------------


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


# -- divergence --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [Leapfrog(), LFAB()], ids=repr)
def test_just_above_the_limit_a_flag_diverges_by_name_soon_after_its_first_bad_number(method):
    scene = presets.flag(6, 7, viscosity=0.3, integrator=method, allow_unstable=True)
    scene = scene.replace(timestep=1.05 * max_timestep(scene))
    start = Simulator(scene)
    random = np.random.default_rng(0).standard_normal((1, 6, 7, 3))
    random[:, :, 0] = 0.0
    sim, watched = Simulator(scene), Simulator(scene)
    for one in (sim, watched):
        one.set_positions(start.positions[0] + 10.0 * random)  # flung far apart: the worst pose, from which it cannot recover
    with pytest.raises(Diverged) as caught:
        sim.step(400_000)
    until = round(caught.value.time / sim.timestep)
    watched.step(max(until - 200, 0))
    first = next(n for n in itertools.count(1) if not finite(watched))
    assert 0 <= until - (max(until - 200, 0) + first) <= 100
    layer, row, col = caught.value.particle
    assert (
        not np.isfinite(sim.run.x[0].reshape(3, 1, 6, 7)[:, layer, row, col]).all()
        or not np.isfinite(sim.run.v[0].reshape(3, 1, 6, 7)[:, layer, row, col]).all()
    )


def finite(sim):
    try:
        sim.step(1)
    except Diverged:
        return False
    return True
