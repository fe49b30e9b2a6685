"""Recipes by name: they hold their promise, take their share of the limit, and keep what they must."""

import math

import numpy as np
import pytest

from flag_env.physics import effects, integrators, max_timestep, presets, tune
from tests.physics.test_tuning_promise import GUST, distance, random_scene


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
