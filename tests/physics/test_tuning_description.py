"""A description tells a scene's limit, error and cost, and what sets them."""

import math

import pytest

from flag_env.physics import Scene, describe, effects, integrators, max_timestep, presets, tune
from flag_env.physics.accuracy import tuning
from tests.physics.test_tuning_promise import distance, random_scene


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
