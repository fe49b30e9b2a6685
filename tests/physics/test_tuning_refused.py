"""Accuracies that no step can promise are refused by what stands in the way."""

import numpy as np
import pytest

from flag_env.physics import Simulator, describe, effects, presets, tune
from flag_env.studies import reference
from tests.physics.test_tuning_promise import apart, limp, oscillator, random_scene


def wild():
    """The same without damping, thrown about until rounding shows."""
    scene = presets.flag(6, 7, stiffness=20.0, viscosity=0.0, drag=0.0)
    force = scene.lattice.masses.mean() * np.array((60.0, 300.0, 150.0))
    return scene.adding(effects.CosineWind(force, (20.0, 25.0, 30.0)))


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
