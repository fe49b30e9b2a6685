"""Every integrator's step limit is where the linear problem starts to grow, and in closed form."""

import math

import numpy as np
import pytest

from flag_env.physics import Diverged, Lattice, Scene, Simulator, max_timestep, presets
from flag_env.physics.effects import AirDrag, CosineWind, Structural
from flag_env.physics.integrators import ExplicitEuler, Implicit, Strang
from flag_env.physics.limits.spectrum import SceneSpectrum
from tests.physics.test_integrators_order import METHODS, every_method, smooth


def chain(stiffness, viscosity, method, factor=1.0):
    """A rope: exactly M x'' + Z x' + K x = 0. The step is `factor` times the limit."""
    lattice = Lattice(1, 1, 7, 1.0, 0.5, pinned="ends", dimensions=1)
    scene = Scene(lattice, (Structural(stiffness, viscosity),), method, allow_unstable=True, timestep=1.0)
    limit = max_timestep(scene)
    return scene.replace(timestep=factor * limit) if 0 < limit < math.inf else scene


def growth(scene, steps):
    sim = Simulator(scene)
    start = np.zeros((1, 1, 7, 3))
    start[0, 0, 1:-1, 2] = np.random.default_rng(0).standard_normal(5)
    sim.set_positions(scene.lattice.rest_positions + start)
    sim.set_velocities(start)
    try:
        sim.step(steps)
    except Diverged:
        return math.inf
    return np.abs(sim.positions - scene.lattice.rest_positions).max()


K, M, TOP = 80.0, 0.5, 4 * math.sin(5 * math.pi / 12) ** 2  # the top eigenvalue of the chain's Laplacian
CRITICAL = 2 * M * math.sqrt(K * TOP / M) / TOP  # viscosity that damps the top mode critically
LINEAR = {"undamped": (K, 0.0), "light": (K, 0.05 * CRITICAL), "strong": (K, 20 * CRITICAL), "damping alone": (0.0, 3.0)}


@pytest.mark.parametrize("case", LINEAR)
@every_method
def test_limit_is_where_the_linear_problem_starts_to_grow(method, case):
    limit = max_timestep(chain(*LINEAR[case], method))
    if isinstance(method, Implicit) or (isinstance(method, Strang) and case == "damping alone"):
        assert limit == math.inf or isinstance(method, Implicit)  # whose limit is that of cloth that turns and buckles
        assert growth(chain(*LINEAR[case], method).replace(timestep=50.0, allow_unstable=True), 500) < 20
        return
    if isinstance(method, ExplicitEuler) and case == "undamped":
        assert limit == 0.0
        return
    slow = 10 if isinstance(method, ExplicitEuler) and case == "light" else 1
    assert growth(chain(*LINEAR[case], method, 0.99), 40_000 * slow) < 20
    assert growth(chain(*LINEAR[case], method, 1.01), 40_000 * slow) > 1e3


def test_limits_in_closed_form():
    mu = TOP / M * LINEAR["strong"][1]
    kappa = TOP / M * K
    found = {repr(m): [max_timestep(chain(*LINEAR[c], m)) for c in ("undamped", "strong")] for m in METHODS}
    expected = {
        "ExplicitEuler()": [0.0, 2 / mu],
        "LFAB()": [2 / math.sqrt(kappa), 2 * (math.sqrt(mu**2 + kappa) - mu) / kappa],
        "Strang(iterations=1)": [2 / math.sqrt(kappa)] * 2,
        "RK4()": [math.sqrt(8 / kappa), 2.785293563405 / mu],
        "Implicit(iterations=2)": [20 / math.sqrt(kappa), 1e3 * LINEAR["strong"][1] / K],
    }
    for start in ("report", "half_kick"):
        expected[f"Leapfrog(start={start!r})"] = [2 / math.sqrt(kappa), (math.sqrt(mu**2 + 4 * kappa) - mu) / kappa]
    assert set(found) == set(expected)
    for name, values in expected.items():
        for limit, value in zip(found[name], values, strict=True):
            assert (1 - 2e-3) * value <= limit <= (1 + 1e-9) * value, name


def test_explicit_euler_refuses_what_is_not_damped():
    taut = smooth("none", ExplicitEuler(), timestep=1e-4).replace(allow_unstable=False).without(AirDrag)
    for scene in (taut, taut.replace(timestep="auto"), taut.adding(Structural(12.0, 0.3, "axial"))):
        assert max_timestep(scene) == 0.0
        with pytest.raises(ValueError, match="ExplicitEuler is unstable at every timestep"):
            Simulator(scene)
    Simulator(taut.replace(allow_unstable=True)).step(3)
    large = presets.flag(12, 20, integrator=ExplicitEuler())
    spectrum = SceneSpectrum(large.lattice, large.effects)
    h = max_timestep(large)
    least = [np.linalg.eigvalsh((spectrum.damping - f * h * spectrum.stiffness).toarray())[0] for f in (0.999, 1.003)]
    assert least[0] > 0 > least[1]


@every_method
def test_just_below_the_limit_a_flag_in_gusts_stays_whole(method):
    scene = smooth("isotropic", method, timestep="auto")
    limit = max_timestep(scene)
    scene = scene.replace(timestep=0.98 * limit if math.isfinite(limit) else 1.0).adding(
        CosineWind((0.5, 0.8, 0.3), (9.0, 7.0, 8.0))
    )
    sim = Simulator(scene)
    sim.advance(20.0 if math.isfinite(limit) else 200.0)
    assert np.linalg.norm(np.diff(sim.positions[0], axis=2), axis=-1).max() < 0.4


@pytest.mark.parametrize("iterations", [1, 2, 3])
@pytest.mark.parametrize("times", [5, 30, 200])
def test_implicit_keeps_an_undamped_flag_whole_far_beyond_the_explicit_limit(times, iterations):
    scene = smooth("none", Implicit(iterations)).without(AirDrag).adding(CosineWind((0.2, 0.4, 0.2), (9.0, 7.0, 8.0)))
    sim = Simulator(scene.replace(timestep=times * max_timestep(scene.replace(integrator=Strang()))))
    sim.step(3000)
    assert np.linalg.norm(np.diff(sim.positions[0], axis=2), axis=-1).max() < 0.5


def test_automatic_steps():
    for method in METHODS:
        scene = smooth("isotropic", method, timestep="auto")
        known = max_timestep(scene)
        if isinstance(method, Implicit):
            known = 3 * max_timestep(scene.replace(integrator=Strang()))
        assert Simulator(scene).timestep == pytest.approx(0.9 * known, rel=1e-9)
