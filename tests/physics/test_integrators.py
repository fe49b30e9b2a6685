"""Checks every integrator against an independent solution, its declared order and limit, and the simulator's contract."""

import dataclasses
import math
import pickle
from itertools import pairwise

import numpy as np
import pytest

from flag_env.physics import Diverged, Lattice, Scene, Simulator, max_timestep, presets
from flag_env.physics.compiling.decorators import jit
from flag_env.physics.effects import AirDrag, CosineWind, Gravity, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Implicit, Integrator, Leapfrog, Strang
from flag_env.physics.integrators._linear_algebra import factorise, improve
from flag_env.physics.limits.spectrum import SceneSpectrum
from flag_env.studies import reference

METHODS = [  # a new integrator joins with one line
    ExplicitEuler(),
    Leapfrog(),
    Leapfrog("half_kick"),
    LFAB(),
    Strang(),
    RK4(),
    Implicit(),
]
REVERSIBLE = [Leapfrog("half_kick"), LFAB(), Strang()]

every_method = pytest.mark.parametrize("method", METHODS, ids=repr)


# -- a smooth scene, whose solution comes from `studies.reference` --------------------------------------------------

DAMPING = {
    "none": (0.0, "isotropic", 0.0),
    "isotropic": (0.15, "isotropic", 0.8),
    "axial": (0.15, "axial", 0.8),
}  # viscosity, kind, drag
END = 0.4
MAST = np.array([0.05, -0.08, 0.1])


def smooth(damping, method=LFAB(), **changes):  # noqa: B008  (immutable)
    viscosity, kind, drag = DAMPING[damping]
    lattice = Lattice(1, 3, 4, (0.1, 0.12), 0.02, 0.4)
    effects = (
        Gravity(),
        Structural(12.0, viscosity, kind),
        Shear(5.0, 0.5 * viscosity, kind, tapered=True),
        AirDrag(drag),
        CosineWind((0.05, 0.1, 0.04), (5.0, 7.0, 3.0), (0.02, 0.0, 0.05), (0.3, 0.0, 1.0)),
    )
    return Scene(lattice, effects, method, allow_unstable=True, **{"timestep": END / 256, **changes})


def beginning(scene):
    """Positions and velocities, (layers, rows, cols, 3): stretched, bulging and moving."""
    random = np.random.default_rng(2)
    rest = scene.lattice.rest_positions
    x = 1.1 * rest + 0.02 * random.standard_normal(rest.shape)
    v = 0.3 * random.standard_normal(rest.shape)
    x[:, :, 0], v[:, :, 0] = rest[:, :, 0], 0.0
    return x, v


@pytest.fixture(scope="module")
def solution():
    """Free particles' positions and velocities at `END`, by kind of damping."""
    found = {}
    for damping in DAMPING:
        x, v = beginning(smooth(damping))
        v[:, :, 0] = MAST / END
        end = reference.solve(smooth(damping), [END], x, v)
        found[damping] = np.concatenate([end.positions, end.velocities])[:, 0, :, 1:]
    return found


def run(scene, steps=None):
    sim = Simulator(scene)
    x, v = beginning(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.set_mast(MAST)
    sim.step(round(END / scene.timestep) if steps is None else steps)
    return sim


ORDERS = [
    *((method, "isotropic", method.order) for method in METHODS),
    (Leapfrog("half_kick"), "none", 2),
    (Strang(), "axial", 1),
    (Strang(2), "axial", 2),
    (Implicit(4), "axial", 2),
    (Implicit(1), "isotropic", 2),
    (Implicit(5), "isotropic", 2),
]


@pytest.mark.parametrize(("method", "damping", "order"), ORDERS, ids=str)
def test_error_falls_with_the_step_as_declared(method, damping, order, solution):
    steps = {1: (1024, 2048, 4096, 8192), 2: (512, 1024, 2048, 4096), 4: (64, 128, 256, 512)}[order]
    ends, errors = [], []
    for n in steps:
        sim = run(smooth(damping, method, timestep=END / n))
        ends.append(np.stack([sim.positions[0, 0, :, 1:], sim.velocities[0, 0, :, 1:]]))
        errors.append(np.sqrt(((ends[-1] - solution[damping]) ** 2).mean(axis=(1, 2, 3))))
    for quantity in np.transpose(errors):
        slope = -np.polyfit(np.log(steps), np.log(quantity), 1)[0]
        assert slope == pytest.approx(order, abs=0.15)
        assert quantity[-1] < 3e-3
    changes = [np.abs(b - a).max() for a, b in pairwise(ends)]
    assert changes[-2] / changes[-1] == pytest.approx(2**order, rel=0.1)  # Richardson


def test_orders_are_declared():
    assert {type(method).__name__: method.order for method in METHODS} == {
        "ExplicitEuler": 1, "Leapfrog": 1, "LFAB": 2, "Strang": 2, "RK4": 4, "Implicit": 2,
    }  # fmt: skip


# -- limits ------------------------------------------------------------------------------------------------------------------


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


# -- energy and time's arrow -------------------------------------------------------------------------------------------------


def conservative(method, **changes):
    return smooth("none", method, **changes).without(AirDrag, CosineWind)


def total_energy(sim):
    return sum(sim.energy().values())[0]


@pytest.mark.parametrize("method", REVERSIBLE, ids=repr)
def test_there_and_back_again(method):
    scene = conservative(method, timestep=4e-3)
    sim = Simulator(scene)
    x, v = beginning(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.step(150)
    assert np.abs(sim.positions[0] - x).max() > 0.1
    there = sim.positions
    sim.set_velocities(-sim.velocities)
    sim.step(150)
    np.testing.assert_allclose(sim.positions[0], x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(sim.velocities[0], -v, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(there.shape, sim.positions.shape)


def energies(method, timestep, seconds=3.0):
    scene = conservative(method, timestep=timestep)
    sim = Simulator(scene)
    x, v = beginning(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    found = [total_energy(sim)]
    for _ in range(60):
        sim.advance(seconds / 60)
        found.append(total_energy(sim))
    return np.array(found) - found[0]


def test_energy_is_kept_driven_or_lost_as_the_method_has_it():
    scale = energies(RK4(), 5e-4)
    moving = 0.02  # J, what the cloth exchanges
    assert np.abs(scale).max() < 1e-6 * moving
    for method in REVERSIBLE:
        coarse, fine = (np.sqrt((energies(method, h) ** 2).mean()) for h in (2e-3, 1e-3))
        assert coarse < 0.05 * moving
        assert coarse / fine == pytest.approx(4.0, rel=0.15)
    assert energies(ExplicitEuler(), 1e-3)[-1] > moving
    lost = energies(Implicit(), 2e-2)
    assert lost[-1] < -1e-3 * moving
    assert lost.max() < 0.1 * moving


# -- the simulator's contract ------------------------------------------------------------------------------------------------


def bits(sim):
    state = sim.get_state()
    arrays = [state.positions, state.velocities, state.history, sim.positions, sim.velocities, *sim.energy().values()]
    return (sim.time, *(np.ascontiguousarray(array).tobytes() for array in arrays))


def shaken(method, dtype="float64", copies=1, **options):
    scene = smooth("isotropic", method, dtype=dtype, timestep=1e-3)
    sim = Simulator(scene, copies=copies, **options)
    x, v = beginning(scene)
    scale = 1 + 0.1 * np.arange(copies)[:, None, None, None, None]
    sim.set_positions(np.broadcast_to(x, (copies, *x.shape)))
    sim.set_velocities(scale * v)
    sim.set_wind(amplitude=0.05 * np.arange(3.0 * copies).reshape(copies, 3) / copies)
    return sim


@every_method
def test_copies_threads_and_groups_of_steps_do_not_change_a_bit(method):
    sims = [shaken(method, copies=5, threads=threads) for threads in (1, 2)]
    for sim in sims:
        sim.set_mast(MAST)
        sim.step(400)
        sim.step(40)
    assert 5 * 12 * 400 > 20_000  # enough to wake threads
    assert bits(sims[0]) == bits(sims[1])
    for copy in (0, 3):
        single = shaken(method)
        many = shaken(method, copies=5)
        single.set_velocities(many.velocities[copy])
        single.set_wind(amplitude=0.05 * np.arange(15.0).reshape(5, 3)[copy] / 5)
        single.set_mast(MAST)
        single.step(400)
        for n in (1, 19, 20):
            single.step(n)
        np.testing.assert_array_equal(single.positions[0], sims[0].positions[copy])
        np.testing.assert_array_equal(single.velocities[0], sims[0].velocities[copy])


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@every_method
def test_a_state_holds_all_that_a_method_remembers(method, dtype):
    sim = shaken(method, dtype, copies=2)
    sim.step(20)
    state = pickle.loads(pickle.dumps(sim.get_state()))
    assert {array.dtype for array in (state.positions, state.velocities, state.history)} == {np.dtype(dtype)}
    other = shaken(method, dtype, copies=2)
    other.step(7)
    other.set_state(state)
    assert bits(other) == bits(sim)
    copied = pickle.loads(pickle.dumps(sim))
    for one in (sim, other, copied):
        one.step(30)
    assert bits(other) == bits(sim) == bits(copied)
    some = shaken(method, dtype, copies=2)
    some.step(50)
    some.set_state(state, copies=[1])
    some.step(30)
    np.testing.assert_array_equal(some.positions[1], sim.positions[1])
    with pytest.raises(ValueError, match="same scene"):
        sim.set_state(dataclasses.replace(state, history=np.zeros((2, 3, 3, 12), dtype)))


@every_method
def test_velocities_set_anew_leave_nothing_of_the_past(method):
    sim, fresh = shaken(method), shaken(method)
    x, v = fresh.positions, fresh.velocities
    sim.step(33)
    sim.set_state(dataclasses.replace(fresh.get_state(), history=sim.get_state().history))
    sim.set_positions(x)
    sim.set_velocities(v)
    np.testing.assert_array_equal(sim.velocities, v)
    for one in (sim, fresh):
        one.step(40)
    assert bits(sim) == bits(fresh)


@every_method
def test_parameters_scaled_while_running(method):
    sim = shaken(method)
    sim.step(10)
    scene = sim.scene.scaled(0.5, 0.8)
    other = Simulator(scene)
    other.set_state(dataclasses.replace(sim.get_state(), scene=scene))
    sim.set_parameters(0.5, 0.8)
    for one in (sim, other):
        one.step(30)
    assert bits(sim) == bits(other)


@every_method
def test_divergence_is_told_and_healed(method):
    sim, healthy = shaken(method, copies=2), shaken(method, copies=2)
    velocities = sim.velocities
    velocities[1, 0, 1, 2], velocities[1, 0, 1, 3] = 1.7e308, -1.7e308
    sim.set_velocities(velocities)
    with pytest.raises(Diverged) as caught:
        sim.step(120)
    healthy.step(120)
    assert caught.value.copy == 1
    np.testing.assert_array_equal(sim.positions[0], healthy.positions[0])
    np.testing.assert_array_equal(sim.velocities[0], healthy.velocities[0])
    sim.set_state(healthy.get_state(), copies=[1])
    for one in (sim, healthy):
        one.step(40)
    assert bits(sim) == bits(healthy)


@every_method
def test_single_precision_in_the_plane_agrees_with_double_in_space(method):
    scene = smooth("isotropic", method).without(CosineWind)
    flat = scene.replace(lattice=dataclasses.replace(scene.lattice, dimensions=2), dtype="float32")
    x, v = beginning(scene)
    x[..., 1] = v[..., 1] = 0.0
    ends = []
    for one in (scene, flat):
        sim = Simulator(one)
        sim.set_positions(x)
        sim.set_velocities(v)
        sim.step(200)
        ends.append(np.stack([sim.positions, sim.velocities]))
    assert np.abs(ends[0][0] - x).max() > 0.05
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=2e-5)


@every_method
def test_a_method_is_a_value(method):
    assert pickle.loads(pickle.dumps(method)) == method
    assert hash(dataclasses.replace(method)) == hash(method)
    with pytest.raises(dataclasses.FrozenInstanceError):
        method.something = 1
    rope = presets.rope(8, integrator=method, timestep="auto")
    data = method.bind(np.dtype("float32"), 1e-3, SceneSpectrum(rope.lattice, rope.effects))
    kept = {"seconds", "iterations", "factor"}
    assert {np.asarray(value).dtype for name, value in data._asdict().items() if name not in kept} == {np.dtype("float32")}
    if hasattr(data, "factor"):
        assert {array.dtype for array in data.factor[1:]} == {np.dtype("float32")}


@every_method
def test_scenes_without_free_particles_or_links(method):
    for lattice in (Lattice(1, 1, 1), Lattice(1, 2, 2, pinned="sleeve"), Lattice(1, 1, 3, pinned="none", dimensions=1)):
        sim = Simulator(Scene(lattice, (Gravity(8.0),), method, timestep=0.125))
        sim.step(4)
        fallen = np.where(lattice.fixed, 0.0, (sim.positions[0] - lattice.rest_positions)[..., 2].ravel())
        assert fallen[~lattice.fixed] == pytest.approx(-1.0, abs=0.6)


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match="start must be one of 'report', 'half_kick', got 'late'"):
        Leapfrog("late")
    for kind in (Strang, Implicit):
        with pytest.raises(ValueError, match="iterations must be at least 1, got 0"):
            kind(0)
    for name in ("limit", "useful"):
        with pytest.raises(NotImplementedError, match="limit"):
            getattr(Integrator(), name)(None)
    with pytest.raises(NotImplementedError, match="bind"):
        Integrator().bind(None, 1.0, None)


# -- the parts ---------------------------------------------------------------------------------------------------------------


@jit
def solved(factor, change, f, r, h):
    improve(factor, change, f, r, h)


@pytest.mark.parametrize(
    "scene", [presets.flag(5, 9), presets.two_layer_flag(3, 4), presets.rope(3), presets.flag(2, 2)], ids=str
)
def test_banded_factor_solves_the_system(scene):
    spectrum = SceneSpectrum(scene.lattice, scene.effects)
    p, q, h = 0.003, 2e-5, 0.7
    factor = factorise(spectrum, np.dtype(float), p, q)
    random = np.random.default_rng(0)
    change, f = random.standard_normal((2, scene.lattice.dimensions, scene.lattice.size))
    found = change.copy()
    solved(factor, found, f, np.zeros((3, scene.lattice.size)), h)
    root = np.sqrt(spectrum.masses)
    matrix = np.outer(root, root) * (np.eye(len(root)) + (p * spectrum.damping + q * spectrum.stiffness).toarray())
    free = spectrum.free
    expected = np.linalg.solve(matrix, (h * f - scene.lattice.masses * change)[:, free].T).T
    np.testing.assert_allclose((found - change)[:, free], expected, rtol=1e-11, atol=1e-13 * np.abs(expected).max())
    assert not (found - change)[:, scene.lattice.fixed].any()


def test_band_is_as_narrow_as_the_cloth():
    for rows, cols in ((6, 20), (20, 6)):
        scene = presets.flag(rows, cols)
        factor = factorise(SceneSpectrum(scene.lattice, scene.effects), np.dtype(float), 1.0, 1.0)
        assert factor.columns.shape[1] <= 24


def test_compiled_methods_compute_what_their_sources_say(run_python, tmp_path):
    x, v = beginning(smooth("isotropic"))
    with (tmp_path / "cases").open("wb") as file:
        pickle.dump(([smooth("isotropic", method, timestep=2e-3) for method in METHODS], x, v), file)
    script = f"""
import pickle, numpy as np, numba
from flag_env.physics import Simulator
scenes, x, v = pickle.load(open({str(tmp_path / "cases")!r}, "rb"))
ends = []
for scene in scenes:
    sim = Simulator(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.set_mast({MAST.tolist()})
    sim.step(3)
    sim.step(1)
    ends.append((sim.positions, sim.velocities))
pickle.dump((numba.config.DISABLE_JIT, np.array(ends)), open({str(tmp_path)!r} + "/ends", "wb"))
"""
    ends = []
    for disable in ("1", "0"):
        run_python(script, NUMBA_DISABLE_JIT=disable)
        with (tmp_path / "ends").open("rb") as file:
            disabled, found = pickle.load(file)
        assert disabled == int(disable)
        ends.append(found)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-13)
