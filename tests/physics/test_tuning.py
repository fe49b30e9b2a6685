"""Accuracy as a dial: what is asked for holds against a solution written without the kernels; recipes, descriptions, errors."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.integrate

from flag_env.physics import Lattice, Scene, Simulator, describe, effects, integrators, max_timestep, presets, tune
from flag_env.physics.accuracy import calibration, store, tuning
from flag_env.physics.compiling import disk_cache
from flag_env.studies import reference

GUST = (12.0, 8.0, 5.0)
"""Acceleration of the cloth by a steady wind [m/s^2]."""


def random_scene(number, windy=True):
    """A small flag of random material in a random wind that swings, or in none; all hold the same effects and compile once."""
    rng = np.random.default_rng((4, number))
    rows, cols = rng.integers(4, 7), rng.integers(4, 8)
    scene = presets.flag(
        int(rows), int(cols),
        length=rng.uniform(0.5, 2), height=rng.uniform(0.4, 1.5), density=rng.uniform(0.05, 0.4), taper=rng.uniform(0.1, 1),
        stiffness=10 ** rng.uniform(1.3, 2.8), viscosity=10 ** rng.uniform(-2.5, -1.5), drag=rng.uniform(0.2, 3),
        pinned=("edge", "sleeve")[rng.integers(2)],
    )  # fmt: skip
    mass = windy * scene.lattice.masses.mean()
    wind = effects.CosineWind(
        mass * rng.uniform(-8, 8, 3), rng.uniform(0, 12, 3), mass * rng.uniform(-8, 8, 3), rng.uniform(0, 6, 3)
    )
    return scene.adding(wind)


def run(scene, start=None, seed=0):
    """The instants of all steps of the first second, and the positions there."""
    simulator = Simulator(scene, seed=seed)
    if start is not None:
        simulator.set_positions(start)
    positions, frame = [], simulator.frame()
    for _ in range(round(1 / simulator.timestep)):
        assert simulator.step_into(1, frame) == 1
        positions.append(frame.positions[0].copy())
    return np.arange(1, len(positions) + 1) * simulator.timestep, np.array(positions)


def apart(path, exact):
    """Worst RMS distance [m]."""
    return np.sqrt(((path - exact) ** 2).sum(axis=-1).mean(axis=(1, 2, 3))).max()


def distance(scene, seed=0, displaced=0.0):
    """Worst RMS distance of the scene's path from DOP853's solution over the steps of one second [m]."""
    start = Simulator(scene.replace(dtype="float64"), seed=seed).positions[0]
    if displaced:
        move = np.random.default_rng(seed).normal(0, displaced / math.sqrt(3), (scene.lattice.size, 3))
        move[scene.lattice.fixed] = 0.0
        start += move.reshape(start.shape)
    times, path = run(scene, start)
    return apart(path, reference.path(scene, times, start))


def cost(scene):
    """Evaluations of the forces in float64 that a second takes as long as."""
    return calibration.price_of(scene) / scene.timestep


@pytest.mark.parametrize("windy", [True, False])
@pytest.mark.parametrize("number", range(10))
def test_the_accuracy_asked_for_holds(number, windy):
    """From 1 mm to 0.1 micrometre, on a scene of its own, at every step."""
    scene, tolerance = random_scene(number, windy), (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)[number % 5]
    tuned = tune(scene, tolerance)
    assert (tuned.lattice, tuned.effects) == (scene.lattice, scene.effects)
    assert distance(tuned) <= tolerance


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("damped", [{}, {"viscosity": 0.0}, {"viscosity": 0.0, "drag": 0.0}], ids=["damped", "drag", "undamped"])
def test_a_calm_flag_swings_as_promised(damped, tolerance):
    """In no wind but its own; undamped it falls, folds and shakes."""
    assert distance(tune(presets.flag(6, 9, **damped), tolerance)) <= tolerance


def test_the_example_of_the_readme_holds():
    tuned = tune(presets.flag(rows=10, cols=16), 1e-5)
    assert distance(tuned) <= 1e-5
    assert describe(tuned).error == pytest.approx(distance(tuned), rel=0.02)


def test_the_accuracy_holds_at_every_step_and_not_only_on_film():
    """A damped flag in a steady wind, whose error is largest in its first hundredth of a second."""
    scene = presets.flag(5, 7, viscosity=0.3)
    scene = scene.adding(effects.CosineWind(mean=scene.lattice.masses.mean() * np.array(GUST)))
    assert distance(tune(scene, 1e-6)) <= 1e-6


@pytest.mark.parametrize("make", [presets.sheet, lambda rows, cols: presets.rope(cols, pinned="edge")], ids=["sheet", "rope"])
def test_the_accuracy_holds_in_fewer_dimensions(make):
    """A rope at rest, that would be exact at any timestep, is pulled."""
    scene = make(4, 6)
    force = 50.0 * scene.lattice.masses.mean()
    scene = scene.adding(effects.CosineWind(mean=(0.0, 0.0, force)))
    assert 1e-8 < distance(tune(scene, 1e-5)) <= 1e-5


def oscillator(hertz, swing=0.05):
    """A mass on a spring of 0.5 m that a steady force begins to pull along it: x = 0.5 + swing (1 - cos(w t))."""
    mass = 0.1
    stiffness = mass * (2 * math.pi * hertz) ** 2
    lattice = Lattice(1, 1, 2, 0.5, mass)
    return Scene(lattice, (effects.Structural(stiffness, 0.0), effects.CosineWind(mean=(swing * stiffness, 0.0, 0.0))))


@pytest.mark.parametrize("hertz", [25.0, 50.0, 37.3])
def test_an_oscillator_as_fast_as_film(hertz):
    """Frames 0.04 s apart see it at rest; every tolerance is to hold, and none is refused between two that are accepted."""
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        times, path = run(tune(oscillator(hertz), tolerance))
        exact = 0.5 + 0.05 * (1 - np.cos(2 * math.pi * hertz * times))
        assert np.abs(path[:, 0, 0, 1, 0] - exact).max() / math.sqrt(2) <= tolerance  # one of two particles moves


@pytest.mark.parametrize("number", range(12))
def test_the_accuracy_asked_for_holds_from_displaced_starts(number):
    """Every particle displaced by itself, 1 cm in the root mean square; other displacements than the calibration's."""
    scene, tolerance = random_scene(number, number % 3 > 0), (1e-3, 4e-4)[number % 2]
    tuned = tune(scene, tolerance, displaced=0.01)
    assert distance(tuned, seed=100 + number, displaced=0.01) <= tolerance
    assert distance(tuned) <= tolerance


def test_displaced_starts_cost_what_they_need():
    scene = random_scene(0)
    own, covered = tune(scene, 4e-4), tune(scene, 4e-4, displaced=0.01)
    assert distance(own, seed=100, displaced=0.01) > 4e-4 > distance(covered, seed=100, displaced=0.01)
    with pytest.raises(ValueError, match=r"displaced must be finite and >= 0, got -1"):
        tune(scene, 1e-3, displaced=-1)


def test_a_calibration_is_remembered_and_a_spoilt_one_is_made_anew(monkeypatch, tmp_path):
    monkeypatch.setattr(store, "cache_root", lambda: tmp_path)

    def tuned(tolerance=1e-4, displaced=0.0):
        calibration.calibrate.cache_clear()  # as in a new process
        return tune(random_scene(0), tolerance, displaced)

    first = tuned()
    (file,) = tmp_path.rglob("calibrations/*")
    kept = file.read_bytes()
    for spoilt in ("", "[]", '{"integrator": "LFAB()", "steps": 0, "dtype": "float32", "error": 0}', '{"steps": 3}'):
        disk_cache.keep_on_disk(file, spoilt.encode())  # whole, and yet of no use
        assert tuned() == first
        assert file.read_bytes() == kept
    for damaged in (b"", kept[:-5], kept.replace(b"LFAB", b"LFAX"), kept.replace(b"steps", b"stops")):
        monkeypatch.setattr(disk_cache, "_told", set())
        file.write_bytes(damaged)
        with pytest.warns(RuntimeWarning, match="damaged, and made anew"):
            assert tuned() == first
        assert file.read_bytes() == kept
    tuned(2e-4)
    tuned(1e-4, 1e-3)
    assert len(list(tmp_path.rglob("calibrations/*"))) == 3
    monkeypatch.setattr(calibration, "_search", None)
    assert tuned() == first  # there is nothing to search with
    assert tuned().timestep.hex() == first.timestep.hex()
    monkeypatch.undo()
    calibration.calibrate.cache_clear()


def test_a_calibration_is_kept_under_all_that_it_depends_on(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    disk_cache.cache_root.cache_clear()
    scene = presets.flag(4, 5)

    @dataclasses.dataclass(frozen=True)
    class Foreign(effects.Gravity):
        pass

    try:
        names = [store.file_of(*asked) for asked in ((scene, 1e-4, 0.0), (scene, 1e-4, 1.0), (scene, 2e-4, 0.0))]
        names.append(store.file_of(scene.scaled(stiffness=1 + 1e-15), 1e-4, 0.0))
        monkeypatch.setattr(store, "source_digest", lambda: "other sources")
        names.append(store.file_of(scene, 1e-4, 0.0))
        assert len(set(names)) == 5
        assert store.file_of(scene.adding(Foreign()), 1e-4, 0.0) is None
        monkeypatch.setattr(store, "cache_root", lambda: None)
        assert store.file_of(scene, 1e-4, 0.0) is None
        assert store.load(None) is None
        store.keep(None, {})
        (tmp_path / "file").touch()
        monkeypatch.setattr(disk_cache, "_told", set())
        with pytest.warns(RuntimeWarning, match="is not kept"):
            store.keep(tmp_path / "file" / "x.json", {})  # no folder there
    finally:
        monkeypatch.undo()
        disk_cache.cache_root.cache_clear()


def test_a_looser_accuracy_never_costs_more():
    scenes = [tune(random_scene(0), 10.0**-digits) for digits in range(3, 10)]
    costs = [cost(scene) for scene in scenes]
    assert costs == sorted(costs)
    assert costs[-1] > 3 * costs[0]
    assert (scenes[0].dtype, scenes[-1].dtype) == ("float32", "float64")
    assert isinstance(scenes[-1].integrator, integrators.RK4)


@pytest.mark.parametrize("windy", [True, False])
def test_nothing_that_is_cheaper_is_as_accurate(windy):
    """Every integrator in both dtypes, from its longest timestep on in steps of a fifth, against DOP853."""
    scene = random_scene(1, windy)
    ways, instants = [], set()
    for method in integrators.CATALOGUE:
        for dtype in ("float32", "float64"):
            way = scene.replace(integrator=method, dtype=dtype)
            limit = max_timestep(way)
            for shorter in (1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0, 4.0, 6.0, 9.0, 14.0):
                steps = max(25, math.ceil(shorter / (0.9 * limit)) if math.isfinite(limit) else round(25 * shorter**2))
                ways.append(way.replace(timestep=1 / steps))
                instants |= {i / steps for i in range(1, steps + 1)}
    times = np.array(sorted(instants))
    exact = reference.path(scene, times)
    errors = {}
    for way in ways:
        own, path = run(way)
        errors[way] = apart(path, exact[np.searchsorted(times, own - 1e-12)])
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        chosen = tune(scene, tolerance)
        quickest = min(cost(way) for way, error in errors.items() if error <= tolerance)
        assert cost(chosen) <= 1.35 * quickest, (tolerance, chosen.integrator, chosen.dtype, 1 / chosen.timestep)


@pytest.mark.parametrize("stiffness", [3e4, 300.0])
def test_strong_damping_is_taken_implicitly(stiffness):
    """Explicit methods need ten thousand steps; SciPy's Radau, implicit too, knows the motion."""
    scene = presets.flag(5, 7, stiffness=stiffness, viscosity=20.0)
    tuned = tune(scene, 1e-3)
    assert isinstance(tuned.integrator, integrators.Implicit)
    assert tuned.timestep == pytest.approx(0.04)
    explicit = scene.replace(integrator=integrators.LFAB(), dtype="float32")
    assert cost(tuned) < 0.05 * cost(explicit.replace(timestep=max_timestep(explicit)))
    times, path = run(tuned)
    start = Simulator(scene).positions[0]
    slope = reference.right_hand_side(scene)
    state = np.stack([start, 0 * start]).ravel()
    exact = scipy.integrate.solve_ivp(slope, (0, 1 + 1e-9), state, "Radau", t_eval=times, rtol=1e-8, atol=1e-10).y
    assert apart(path, exact.T.reshape(len(times), 2, *start.shape)[:, 0]) <= 1e-3


@dataclasses.dataclass(frozen=True)
class Quick(integrators.RK4):
    """An integrator from outside that says it takes one evaluation a step."""

    evaluations = 1


@dataclasses.dataclass(frozen=True)
class Slow(integrators.RK4):
    """Another, that says it takes a hundred and a solution."""

    evaluations, solutions = 100, 1


def test_an_integrator_from_outside_is_a_candidate_at_its_own_price():
    scene = random_scene(2)
    assert tune(scene.replace(integrator=Quick()), 1e-5).integrator == Quick()
    assert tune(scene.replace(integrator=Slow()), 1e-5) == tune(scene, 1e-5)
    assert store.file_of(scene.replace(integrator=Quick()), 1e-5) is None
    thorough = integrators.Implicit(iterations=3)
    assert thorough in calibration.candidates(scene.replace(integrator=thorough))


def in_gust(scene):
    force = scene.lattice.masses.mean() * np.array(GUST)
    return scene.adding(effects.CosineWind(mean=force))


@pytest.mark.parametrize(("name", "promise"), [("balanced", 1e-3), ("reference", 1e-6)])
def test_recipes_hold_their_promise_on_the_default_flag(name, promise):
    assert distance(in_gust(tune(presets.flag(10, 16), name, multiple_of=0.04))) < promise


def test_fast_is_the_flag_on_half_the_lattice():
    """Size, areal density and stiffness per width held, as `presets.flag` holds them; forces per particle follow its mass."""
    scene = tune(in_gust(presets.flag(10, 16)), "fast")
    same = in_gust(presets.flag(5, 8, integrator=integrators.LFAB(), dtype="float32"))
    assert scene.lattice == same.lattice
    assert scene.without(effects.CosineWind).effects == same.without(effects.CosineWind).effects
    assert scene.perturbation == pytest.approx(same.perturbation, rel=1e-12)
    wind, expected = (next(e for e in s.effects if isinstance(e, effects.CosineWind)) for s in (scene, same))
    assert wind.mean == pytest.approx(expected.mean, rel=1e-12)
    assert (scene.integrator, scene.dtype) == (same.integrator, same.dtype)
    assert 0 < scene.timestep <= 0.9 * max_timestep(scene)


def test_fast_keeps_a_lattice_that_is_not_a_plain_cloth():
    for scene in (presets.two_layer_flag(10, 16), presets.storm_flag(10, 16), presets.rope(), presets.flag(4, 16)):
        assert tune(scene, "fast") == tune(scene, "balanced")


def test_a_scene_is_judged_by_its_own_motion():
    """Without a wind, in one that is calm, and in one whose force is none: the same motion, so the same answer."""
    scene = random_scene(4, windy=False)
    tuned = tune(scene, 1e-4)
    assert tuned == tune(scene.without(effects.CosineWind), 1e-4).replace(effects=tuned.effects)
    windy = tune(random_scene(4), 1e-4)
    assert cost(windy) != cost(tuned)


@pytest.mark.parametrize("accuracy", ["fast", "balanced", "reference", 1e-4])
def test_a_timestep_divides_what_it_is_to_divide(accuracy):
    scene = random_scene(0)
    for whole in (0.04, 1 / 30, 0.7):
        tuned = tune(scene, accuracy, multiple_of=whole)
        assert whole / tuned.timestep == pytest.approx(round(whole / tuned.timestep), abs=1e-9)
        assert tuned.timestep <= max_timestep(tuned)
    with pytest.raises(ValueError, match=r"multiple_of must be finite and > 0, got 0"):
        tune(scene, accuracy, multiple_of=0)


def test_the_accuracy_holds_on_a_control_step():
    tuned = tune(random_scene(3), 1e-5, multiple_of=0.04)
    assert distance(tuned) <= 1e-5


def test_a_recipe_alone_takes_its_share_of_the_limit():
    scene = random_scene(0)
    assert tune(scene, "balanced").timestep == pytest.approx(0.9 * max_timestep(tune(scene, "balanced")), rel=1e-12)
    assert tune(scene, "reference").timestep == pytest.approx(0.5 * max_timestep(tune(scene, "reference")), rel=1e-12)


@pytest.mark.parametrize("accuracy", [0.0, -1e-3, math.nan, math.inf])
def test_an_accuracy_must_be_a_positive_number(accuracy):
    with pytest.raises(ValueError, match=r"accuracy must be finite and > 0, got "):
        tune(presets.flag(4, 4), accuracy)


def test_an_accuracy_is_a_number_or_a_known_name():
    with pytest.raises(ValueError, match=r"accuracy must be one of 'fast', 'balanced', 'reference', got 'best'"):
        tune(presets.flag(4, 4), "best")
    with pytest.raises(TypeError, match=r"accuracy must be a number, got None"):
        tune(presets.flag(4, 4), None)


def limp():
    """A limp flag in a wind of three times its weight that turns round thrice a second."""
    scene = presets.flag(6, 7, stiffness=20.0, viscosity=1e-3, drag=0.2)
    force = scene.lattice.masses.mean() * np.array((0.0, 30.0, 15.0))
    return scene.adding(effects.CosineWind(force, (20.0, 25.0, 30.0)))


def wild():
    """The same without damping, thrown about until rounding shows."""
    scene = presets.flag(6, 7, stiffness=20.0, viscosity=0.0, drag=0.0)
    force = scene.lattice.masses.mean() * np.array((60.0, 300.0, 150.0))
    return scene.adding(effects.CosineWind(force, (20.0, 25.0, 30.0)))


def test_a_path_that_can_be_known_is_within_reach():
    for tolerance in (1e-6, 1e-8):
        assert distance(tune(limp(), tolerance)) <= tolerance


@pytest.mark.parametrize(
    "make", [lambda: random_scene(0, windy=False), lambda: oscillator(50.0), limp, pytest.param(wild, marks=pytest.mark.slow)]
)
def test_what_is_refused_is_out_of_reach_and_what_is_named_is_kept(make):
    """No coarser tolerance is refused where a finer one is not, and the number in the refusal is the border."""
    scene = make()
    with pytest.raises(ValueError, match=r"accuracy must be at least [\d.e-]+ m for this scene, got 1e-16 m") as refusal:
        tune(scene, 1e-16)
    least = float(str(refusal.value).split("at least ")[1].split(" m ")[0])
    kept = tune(scene, least)
    assert describe(kept).error <= least
    with pytest.raises(ValueError, match=r"accuracy must be at least"):
        tune(scene, 0.97 * least)
    for larger in (3.0, 10.0, 1e3, 1e6):
        assert tune(scene, larger * least).timestep > 0
    assert least < 1e-11 * max(1.0, growth(scene))


def growth(scene):
    """How much farther apart two of DOP853's solutions get than their starts were."""
    start = Simulator(scene).positions[0]
    move = 1e-9 * np.random.default_rng(0).standard_normal(start.shape) * ~scene.lattice.fixed.reshape(*scene.lattice.shape, 1)
    move[..., [axis for axis in range(3) if not np.ptp(start[..., axis])]] = 0.0
    times = np.linspace(0.01, 1, 100)
    both = [reference.path(scene, times, start + sign * move, rtol=1e-12, atol=1e-14) for sign in (-1, 1)]
    return apart(*both) / (2e-9 * np.abs(start).max())


@pytest.mark.parametrize(
    "effect",
    [
        effects.SelfCollision(),
        effects.MastCollision(),
        effects.StrainLimit(),
        effects.Tearing(),
        effects.Gusts(),
        effects.AirPressure(gusts=effects.Gusts()),
    ],
)
def test_effects_without_an_order_are_named(effect):
    scene = presets.flag(5, 6).without(effects.CosineWind).adding(effect)
    with pytest.raises(ValueError, match=rf"scene must hold no {type(effect).__name__} for a tolerance .* 'balanced'"):
        tune(scene, 1e-3)


def test_description():
    scene = tune(random_scene(3), 1e-4)
    told = describe(scene)
    assert told.error <= 1e-4
    assert told.error == pytest.approx(distance(scene), rel=0.02)
    assert told.timestep == scene.timestep
    assert told.limit == max_timestep(scene)
    assert told.steps == told.evaluations == pytest.approx(1 / scene.timestep)
    assert told.wall > 0
    for part in (told.integrator, told.dtype, "of the limit", told.limited_by, "force evaluations", "mm RMS within one second"):
        assert part in str(told)


def test_description_names_the_effect_that_sets_the_limit():
    """A hundredfold drag damps more than the links do; without links and drag nothing sets a limit."""
    flag = presets.flag(5, 6, integrator=integrators.LFAB())
    assert describe(flag).limited_by == "the stiffness of Structural"
    assert describe(flag.adding(effects.AirDrag(1e5))).limited_by == "the damping of AirDrag"


def test_a_scene_without_an_order_is_described_but_for_its_error():
    told = describe(Scene(presets.flag(5, 6).lattice, (effects.Gravity(), effects.MastCollision())))
    assert told.error is None
    assert told.limited_by is None
    assert "no limit" in str(told)
    assert "MastCollision" in str(told)


@pytest.mark.parametrize("cost", [1e-9, 4e-7, 3e-3, 2.0])
def test_the_time_of_a_step_is_that_of_a_step(cost, monkeypatch):
    """On a clock that only steps advance, however long they take."""
    clock = [0.0]

    class Steps:
        def __init__(self, scene, threads):
            pass

        def get_state(self):
            return None

        def set_state(self, state):
            pass

        def step(self, n):
            clock[0] += n * cost

    monkeypatch.setattr(tuning, "Simulator", Steps)
    monkeypatch.setattr(tuning.time, "perf_counter", lambda: clock[0])
    assert tuning._seconds_per_step(presets.flag(3, 4)) == pytest.approx(cost, rel=1e-6)


def test_a_scene_that_diverges_is_described():
    scene = presets.flag(4, 5)
    told = describe(scene.replace(timestep=2 * max_timestep(scene), allow_unstable=True))
    assert told.error > 1e9
    assert 0 < told.wall < math.inf
