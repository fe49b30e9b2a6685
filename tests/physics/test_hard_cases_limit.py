"""The README's hard cases of long runs and of the step limit: whole below it, diverging by name just above it."""

import itertools
import math

import numpy as np
import pytest
import scipy.stats

from flag_env.physics import Diverged, Simulator, max_timestep, presets
from flag_env.physics.effects import CosineWind
from flag_env.physics.integrators import LFAB, Leapfrog, Strang
from flag_env.studies import margins
from tests.physics.test_hard_cases_forces import forced, slow, strains, whole

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
