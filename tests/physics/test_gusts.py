"""The gusts' statistics, their way along the flag, and their arguments."""

import math

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator
from flag_env.physics.compiling import jit
from flag_env.physics.effects import AirDrag, CosineWind, Gusts
from flag_env.physics.effects.base import BindContext
from flag_env.physics.effects.wind.turbulence import advance_turbulence, filter_coefficients
from tests.physics.scenes import leapfrog_scene

MOTE = Lattice(1, 1, 1, mass=0.02, pinned="none")
GUSTS = Gusts((1.5, 1.0, 0.5), (2.0, 3.0, 1.0), speed=4.0, mean=(4.0, 0.0, 0.0))


def bind(effect, lattice=MOTE, copies=1, timestep=0.01, seed=0, dtype="float64"):
    return effect.bind(BindContext(lattice, np.dtype(dtype), copies, timestep, seed))


@jit
def fill(turbulence, copy, every, out):
    for k in range(out.shape[0]):
        for _ in range(every):
            advance_turbulence(turbulence, copy)
        for i in range(3):
            out[k, i] = turbulence.history[copy, i, turbulence.head[copy, 0]]


def record(effect, samples, timestep=0.01, every=1, seed=0):
    """Turbulence at the mast [m/s], shape (samples, 3)."""
    out = np.empty((samples, 3))
    fill(bind(effect, timestep=timestep, seed=seed).turbulence, 0, every, out)
    return out


def correlation(lag, time, lateral):
    return (1.0 - 0.5 * lag / time * lateral) * np.exp(-lag / time)


@pytest.mark.parametrize("spectrum", ["dryden", "ou"])
@pytest.mark.parametrize(("timestep", "every"), [(0.02, 1), (0.002, 10)])
def test_variance_and_autocorrelation_are_those_of_the_spectrum(spectrum, timestep, every):
    """Within four standard errors by Bartlett's formula, at any timestep: steps are exact."""
    effect = Gusts(GUSTS.intensity, GUSTS.scale, GUSTS.speed, spectrum=spectrum)
    samples, spacing = 400_000, timestep * every
    g = record(effect, samples, timestep, every)
    lags = np.arange(-20_000, 20_001) * spacing
    for axis, (sigma, length) in enumerate(zip(effect.intensity, effect.scale, strict=True)):
        time, lateral = length / effect.speed, spectrum == "dryden" and axis > 0
        rho = correlation(np.abs(lags), time, lateral)
        assert abs(g[:, axis].mean()) < 4 * sigma * math.sqrt(rho.sum() / samples)
        for steps in (0, 1, 5, 20, 40, 100):
            tau = steps * spacing
            shifted = correlation(np.abs(lags + tau), time, lateral) * correlation(np.abs(lags - tau), time, lateral)
            error = sigma**2 * math.sqrt((rho**2 + shifted).sum() / samples)
            found = (g[: samples - steps, axis] * g[steps:, axis]).mean()
            assert abs(found - sigma**2 * correlation(tau, time, lateral)) < 4 * error
            assert error < 0.03 * sigma**2
        kurtosis = (g[:, axis] ** 4).mean() / (g[:, axis] ** 2).mean() ** 2
        assert abs(kurtosis - 3.0) < 4 * math.sqrt(24.0 * (rho**4).sum() / samples)
    pairs = np.corrcoef(g.T)[np.triu_indices(3, 1)]
    assert np.abs(pairs).max() < 4 * math.sqrt(2 * max(effect.scale) / effect.speed / (samples * spacing))


@pytest.mark.parametrize("step", [1e-9, 1e-4, 0.1, 1.0, 30.0])
@pytest.mark.parametrize("lateral", [False, True])
def test_steps_are_exact(step, lateral):
    """The stationary covariance is kept, and many short steps are one long one."""
    p11, p21, p22, n11, n21, n22, *output = filter_coefficients(step, lateral, 2.0)
    decay = math.exp(-step)
    np.testing.assert_allclose([p11, p21, p22], [decay, step * decay, decay], rtol=1e-12)
    transition, noise = np.array([[p11, 0], [p21, p22]]), np.array([[n11, 0], [n21, n22]])
    kept = np.array([[0.5, 0.25], [0.25, 0.25]])
    np.testing.assert_allclose(transition @ kept @ transition.T + noise @ noise.T, kept, rtol=1e-12)
    assert output @ kept @ output == pytest.approx(4.0, rel=1e-12)
    # the integral of exp(-2 s) (1, s; s, s^2) in closed form; by its series where that cancels
    s = step
    if s < 1e-3:
        covariance = [s - s**2 + 2 / 3 * s**3, s**2 / 2 - 2 / 3 * s**3, s**3 / 3 - s**4 / 2]
    else:
        e = math.exp(-2 * s)
        covariance = [(1 - e) / 2, (1 - e * (1 + 2 * s)) / 4, (1 - e * (1 + 2 * s + 2 * s * s)) / 4]
    found = noise @ noise.T
    np.testing.assert_allclose(found[np.triu_indices(2)], covariance, rtol=1e-6 if s < 1e-3 else 1e-10)


def test_the_past_is_as_likely_as_the_future():
    """The ring starts stationary: over many copies its oldest, newest and next numbers have the same variance and correlation."""
    lattice, copies = Lattice(1, 2, 9, 0.25, 0.02), 6000
    data = bind(GUSTS, lattice, copies, timestep=0.05)
    turbulence = data.turbulence
    head, history = turbulence.head[0, 0], turbulence.history
    old = history[:, :, 0].copy()
    new = history[:, :, head].copy()
    for copy in range(copies):
        data.advance(data, copy, 0.05)
    later = history[np.arange(copies), :, turbulence.head[:, 0]]
    for values in (old, new, later):
        assert np.all(np.abs((values**2).mean(axis=0) / np.square(GUSTS.intensity) - 1) < 4 * math.sqrt(2 / copies))
    span = head * 0.05
    for axis in range(3):
        for a, b, lag in ((old, new, span), (new, later, 0.05), (old, later, span + 0.05)):
            expected = correlation(lag, GUSTS.scale[axis] / GUSTS.speed, axis > 0)
            found = np.corrcoef(a[:, axis], b[:, axis])[0, 1]
            assert abs(found - expected) < 4 * (1 - expected**2) / math.sqrt(copies) + 1e-12


def accelerations(sim, steps):
    """Accelerations over each step [m/s^2], shape (steps, copies, layers, rows, cols, 3)."""
    v = [sim.get_state().velocities]
    for _ in range(steps):
        sim.step()
        v.append(sim.get_state().velocities)
    shape = (steps, sim.copies, -1, *sim.scene.lattice.shape)
    return np.moveaxis(np.diff(v, axis=0).reshape(shape) / sim.timestep, 2, -1)


@pytest.mark.parametrize(("speed", "exact"), [(5.0, True), (3.7, False)])
def test_a_gust_reaches_a_column_after_its_distance_over_the_speed(speed, exact):
    lattice, h = Lattice(2, 3, 8, 0.1, 0.02, 0.3, "none"), 0.005
    effect = Gusts((1.0, 0.8, 0.6), 2.0, speed, mean=(2.0, 1.0, -1.0), rate=2.0)
    air = accelerations(Simulator(leapfrog_scene(lattice, (effect,), timestep=h)), 300)[:, 0] / effect.rate
    np.testing.assert_allclose(air, np.broadcast_to(air[:, :1, :1], air.shape), atol=1e-9)
    mast = air[:, 0, 0, 0]
    for col in range(lattice.cols):
        delay = col * 0.1 / speed / h
        whole, part = int(delay + 1e-9), delay - int(delay + 1e-9)
        expected = (1 - part) * mast[1 : 300 - whole] + part * mast[: 299 - whole]
        np.testing.assert_allclose(air[whole + 1 :, 0, 0, col], expected, atol=1e-9)
        assert not exact or abs(part) < 1e-6


def test_the_air_is_linear_between_two_steps():
    data, lattice = bind(GUSTS, timestep=0.01), MOTE
    found = []
    for lag in (0.0, 0.005, 0.01):
        x, f = np.zeros((2, 3, 1))
        data.force(data, 0, x, x, f, np.zeros((3, 1)), lag)
        found.append(f[:, 0] / (GUSTS.rate * lattice.mass))
    np.testing.assert_allclose(found[1], 0.5 * (found[0] + found[2]), rtol=1e-12)
    data.advance(data, 0, 0.01)
    x, f = np.zeros((2, 3, 1))
    data.force(data, 0, x, x, f, np.zeros((3, 1)), 0.0)
    np.testing.assert_allclose(f[:, 0] / (GUSTS.rate * lattice.mass), found[2], rtol=1e-12)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_no_intensity_is_a_constant_wind(dimensions, dtype):
    lattice = Lattice(1, 4, 6, 0.1, 0.02, 0.3, dimensions=dimensions)
    mean = (3.0, 1.0, -0.5)
    winds = Gusts(0.0, mean=mean, rate=2.0), CosineWind(mean=mean)
    found = []
    for wind in winds:
        data = bind(wind, lattice, dtype=dtype)
        x, v, f = np.zeros((3, dimensions, lattice.size), dtype)
        data.force(data, 0, x, v, f, np.zeros((3, lattice.size), dtype), 0.0)
        assert f.dtype == dtype
        found.append(f)
    tolerance = 1e-12 if dtype == "float64" else 1e-6
    np.testing.assert_allclose(found[0], 2.0 * lattice.masses * found[1], rtol=tolerance)


def test_with_drag_it_is_drag_against_the_air():
    """In a steady wind a free particle's velocity goes to the wind's as 1 - (1 - c h)^n."""
    wind = (4.0, -2.0, 1.0)
    sim = Simulator(leapfrog_scene(MOTE, (AirDrag(1.5), Gusts(0.0, mean=wind, rate=1.5)), timestep=0.01))
    sim.step(100)
    np.testing.assert_allclose(
        sim.get_state().velocities[0, :, 0], np.array(wind) * (1 - (1 - 0.015) ** 100), rtol=1e-12
    )  # fmt: skip


def test_low_altitude_figures():
    """MIL-F-8785C at 100 ft, wind 20 m/s at 20 ft."""
    gusts = Gusts.low_altitude(30.48, 20.0)
    ratio = 0.177 + 0.0823
    assert gusts.intensity == pytest.approx((2 / ratio**0.4, 2 / ratio**0.4, 2.0), rel=1e-12)
    assert gusts.scale == pytest.approx((30.48 / ratio**1.2, 30.48 / ratio**1.2, 30.48), rel=1e-12)
    assert gusts.speed == pytest.approx(20 * math.log(100 / 0.15) / math.log(20 / 0.15), rel=1e-12)
    assert gusts.mean == (gusts.speed, 0.0, 0.0)
    for height in (3.0, 305.0):
        with pytest.raises(ValueError, match="height"):
            Gusts.low_altitude(height, 20.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"intensity": -1.0}, {"intensity": (1.0, 1.0)}, {"scale": 0.0}, {"scale": (1.0, 0.0, 1.0)}, {"speed": 0.0},
        {"rate": -1.0}, {"mean": (1.0,)}, {"spectrum": "von Karman"}, {"intensity": float("nan")},
    ],
)  # fmt: skip
def test_wrong_arguments_are_named(wrong):
    with pytest.raises((ValueError, TypeError), match=next(iter(wrong))):
        Gusts(**wrong)


def test_a_rope_in_one_dimension_is_refused():
    with pytest.raises(ValueError, match="dimensions 2 or 3"):
        Scene(Lattice(1, 1, 5, dimensions=1), (Gusts(),))
