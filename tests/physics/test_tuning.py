"""Accuracy as a dial: what is asked for holds against a solution written without the kernels; recipes, descriptions, errors."""

import dataclasses
import math

import numpy as np
import pytest

from flag_env.physics import Scene, Simulator, calibration, calibration_store, effects, integrators, max_timestep, presets, tuning
from flag_env.physics.calibration import FRAMES, GUST
from flag_env.studies import reference

TIMES = np.arange(1, FRAMES + 1) / FRAMES
"""The frames of one second [s]."""


def random_scene(number):
    """A small flag of random material in a random wind that swings; all hold effects of the same kinds, and compile once."""
    rng = np.random.default_rng((4, number))
    rows, cols = rng.integers(4, 7), rng.integers(4, 8)
    scene = presets.flag(
        int(rows), int(cols),
        length=rng.uniform(0.5, 2), height=rng.uniform(0.4, 1.5), density=rng.uniform(0.05, 0.4), taper=rng.uniform(0.1, 1),
        stiffness=10 ** rng.uniform(1.3, 2.8), viscosity=10 ** rng.uniform(-2.5, -1.5), drag=rng.uniform(0.2, 3),
        pinned=("edge", "sleeve")[rng.integers(2)],
    )  # fmt: skip
    mass = scene.lattice.masses.mean()
    wind = effects.CosineWind(
        mass * rng.uniform(-8, 8, 3), rng.uniform(0, 12, 3), mass * rng.uniform(-8, 8, 3), rng.uniform(0, 6, 3)
    )
    return scene.adding(wind)


def distance(scene, seed=0, displaced=0.0):
    """Worst RMS distance of the scene's path over one second from DOP853's solution [m]."""
    simulator = Simulator(scene, seed=seed)
    if displaced:
        move = np.random.default_rng(seed).normal(0, displaced / math.sqrt(3), (scene.lattice.size, 3))
        move[scene.lattice.fixed] = 0.0
        simulator.set_positions(simulator.positions[0] + move.reshape(simulator.positions[0].shape))
    exact = reference.solve(scene, TIMES, simulator.positions[0]).positions
    steps = round(1 / (FRAMES * scene.timestep))
    path = []
    for _ in TIMES:
        simulator.step(steps)
        path.append(simulator.positions[0])
    return np.sqrt(((np.array(path) - exact) ** 2).sum(axis=-1).mean(axis=(1, 2, 3))).max()


@pytest.mark.parametrize("number", range(20))
def test_the_accuracy_asked_for_holds(number):
    """From 1 mm to 0.1 micrometre, on a scene of its own; half of them started from another seed than the calibration's."""
    scene, tolerance = random_scene(number), (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)[number % 5]
    tuned = scene.tuned(tolerance)
    assert (tuned.lattice, tuned.effects) == (scene.lattice, scene.effects)
    assert distance(tuned, seed=number // 10) <= tolerance


@pytest.mark.parametrize("number", range(20))
def test_the_accuracy_asked_for_holds_from_displaced_starts(number):
    """Every particle displaced by itself, 1 cm in the root mean square; other displacements than the calibration's."""
    scene, tolerance = random_scene(number), (1e-3, 4e-4)[number % 2]
    tuned = scene.tuned(tolerance, displaced=0.01)
    assert distance(tuned, seed=100 + number, displaced=0.01) <= tolerance
    assert distance(tuned) <= tolerance


def test_displaced_starts_cost_what_they_need():
    scene = random_scene(0)
    own, covered = scene.tuned(4e-4), scene.tuned(4e-4, displaced=0.01)
    assert distance(own, seed=100, displaced=0.01) > 4e-4 > distance(covered, seed=100, displaced=0.01)
    with pytest.raises(ValueError, match=r"displaced must be finite and >= 0, got -1"):
        scene.tuned(1e-3, displaced=-1)


def test_a_calibration_is_remembered_and_a_spoilt_one_is_made_anew(monkeypatch, tmp_path):
    monkeypatch.setattr(calibration_store, "cache_root", lambda: tmp_path)

    def tuned(tolerance=1e-4, displaced=0.0):
        calibration.calibrate.cache_clear()  # as in a new process
        return random_scene(0).tuned(tolerance, displaced)

    first = tuned()
    (file,) = tmp_path.rglob("calibrations/*")
    kept = file.read_text()
    for spoilt in ("", kept[:-5], "[]", '{"integrator": "LFAB", "steps": 0, "dtype": "float32", "error": 0}', '{"steps": 3}'):
        file.write_text(spoilt)
        assert tuned() == first
        assert file.read_text() == kept
    tuned(2e-4)
    tuned(1e-4, 1e-3)
    assert len(list(tmp_path.rglob("calibrations/*"))) == 3
    monkeypatch.setattr(calibration, "_search", None)
    assert tuned() == first  # there is nothing to search with
    assert tuned().timestep.hex() == first.timestep.hex()


def test_a_calibration_is_kept_under_all_that_it_depends_on(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    calibration_store.cache_root.cache_clear()
    scene = presets.flag(4, 5)

    @dataclasses.dataclass(frozen=True)
    class Foreign(effects.Effect):
        pass

    try:
        names = [calibration_store.file_of(*asked) for asked in ((scene, 1e-4, 0.0), (scene, 1e-4, 1.0), (scene, 2e-4, 0.0))]
        names.append(calibration_store.file_of(scene.scaled(stiffness=1 + 1e-15), 1e-4, 0.0))
        monkeypatch.setattr(calibration_store, "source_digest", lambda: "other sources")
        names.append(calibration_store.file_of(scene, 1e-4, 0.0))
        assert len(set(names)) == 5
        assert calibration_store.file_of(scene.adding(Foreign()), 1e-4, 0.0) is None
        monkeypatch.setattr(calibration_store, "cache_root", lambda: None)
        assert calibration_store.file_of(scene, 1e-4, 0.0) is None
        assert calibration_store.load(None) is None
        calibration_store.keep(None, {})
        (tmp_path / "file").touch()
        calibration_store.keep(tmp_path / "file" / "x.json", {})  # no folder there
    finally:
        monkeypatch.undo()
        calibration_store.cache_root.cache_clear()


def test_a_looser_accuracy_never_costs_more():
    single, double = {integrators.LFAB: 0.5, integrators.RK4: 2.2}, {integrators.LFAB: 1.0, integrators.RK4: 3.8}
    cost = {"float32": single, "float64": double}
    scenes = [random_scene(0).tuned(10.0**-digits) for digits in range(3, 10)]
    costs = [cost[scene.dtype][type(scene.integrator)] / scene.timestep for scene in scenes]
    assert costs == sorted(costs)
    assert costs[-1] > 3 * costs[0]
    assert [type(scenes[0].integrator), type(scenes[-1].integrator)] == [integrators.LFAB, integrators.RK4]


def in_gust(scene):
    force = scene.lattice.masses.mean() * np.array(GUST)
    return scene.adding(effects.CosineWind(mean=force))


@pytest.mark.parametrize(("name", "promise"), [("balanced", 1e-3), ("reference", 1e-6)])
def test_recipes_hold_their_promise_on_the_default_flag(name, promise):
    assert distance(in_gust(presets.flag(10, 16).tuned(name))) < promise


def test_fast_is_the_flag_on_half_the_lattice():
    """Size, areal density and stiffness per width held, as `presets.flag` holds them; forces per particle follow its mass."""
    scene = in_gust(presets.flag(10, 16)).tuned("fast")
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
        assert scene.tuned("fast") == scene.tuned("balanced")


def test_a_scene_at_rest_is_tuned_in_a_gust():
    scene = presets.flag(5, 6).without(effects.CosineWind)
    assert scene.tuned(1e-4) == presets.flag(5, 6).tuned(1e-4).without(effects.CosineWind)


@pytest.mark.parametrize("accuracy", [0.0, -1e-3, math.nan, math.inf])
def test_an_accuracy_must_be_a_positive_number(accuracy):
    with pytest.raises(ValueError, match=r"accuracy must be finite and > 0, got "):
        presets.flag(4, 4).tuned(accuracy)


def test_an_accuracy_is_a_number_or_a_known_name():
    with pytest.raises(ValueError, match=r"accuracy must be one of 'fast', 'balanced', 'reference', got 'best'"):
        presets.flag(4, 4).tuned("best")
    with pytest.raises(TypeError, match=r"accuracy must be a number, got None"):
        presets.flag(4, 4).tuned(None)


def test_an_accuracy_below_round_off_names_what_is_allowed():
    with pytest.raises(ValueError, match=r"accuracy must be at least [\d.e-]+ m for this scene, got 1e-15 m"):
        random_scene(0).tuned(1e-15)


def test_an_accuracy_past_the_horizon_is_refused_and_the_one_named_is_kept():
    """A limp flag in a wind of three times its weight that turns round thrice a second."""
    scene = presets.flag(6, 7, stiffness=20.0, viscosity=1e-3, drag=0.2)
    force = scene.lattice.masses.mean() * np.array((0.0, 30.0, 15.0))
    scene = scene.adding(effects.CosineWind(force, (20.0, 25.0, 30.0)))
    with pytest.raises(ValueError, match=r"past its horizon") as refusal:
        scene.tuned(1e-6)
    least = float(str(refusal.value).split("at least ")[1].split(" m ")[0])
    assert least > 1e-5  # far above round-off
    assert distance(scene.tuned(least)) <= least


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
        scene.tuned(1e-3)


def test_description():
    scene = random_scene(3).tuned(1e-4)
    told = scene.describe()
    assert told.error <= 0.5e-4
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
    assert flag.describe().limited_by == "the stiffness of Structural"
    assert flag.adding(effects.AirDrag(1e5)).describe().limited_by == "the damping of AirDrag"


def test_a_scene_without_an_order_is_described_but_for_its_error():
    told = Scene(presets.flag(5, 6).lattice, (effects.Gravity(), effects.MastCollision())).describe()
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
    told = scene.replace(timestep=1.5 * max_timestep(scene), allow_unstable=True).describe()
    assert told.error is None
    assert 0 < told.wall < math.inf
