"""What is chosen for an accuracy: nothing cheaper is as accurate, and a calibration is remembered under all it depends on."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.integrate

from flag_env.physics import Simulator, effects, integrators, max_timestep, presets, tune
from flag_env.physics.accuracy import calibration, store
from flag_env.physics.compiling import disk_cache
from flag_env.studies import reference
from tests.physics.test_tuning_promise import apart, cost, random_scene, run


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
