"""Corrections together: effects that move particles after a step, in one scene, under every integrator.

What each of them promises by itself stands in `test_effects`.
"""

import numpy as np
import pytest

from flag_env.physics import Scene, Simulator, diagnostics, effects, integrators, max_timestep, presets

PROJECTIONS = [
    effects.SelfCollision(),
    effects.MastCollision(),
    effects.StrainLimit(),
    effects.Tearing(0.2),
]
METHODS = [method for method in integrators.CATALOGUE if type(method).__name__ != "ExplicitEuler"]
WIND = (0.02, 0.03, 0.0)

every_projection = pytest.mark.parametrize("effect", PROJECTIONS, ids=lambda effect: type(effect).__name__)
every_method = pytest.mark.parametrize("method", METHODS, ids=lambda method: type(method).__name__)


def flag(*more, **fields) -> Scene:
    return presets.flag(5, 7, stiffness=60.0, viscosity=0.01, **{"timestep": 1e-3, **fields}).adding(*more)


def run(scene, steps=300, **options):
    sim = Simulator(scene, copies=2, **options)
    sim.set_wind(mean=[WIND, (-0.02, 0.01, 0.0)])
    sim.step(steps)
    return sim


@every_method
def test_all_of_them_together_keep_what_they_promise_and_continue_to_the_bit(method):
    """In a wind that folds the flag, tears it and blows it against the pole; the last among them promises most."""
    pole = 0.02
    scene = flag(
        effects.MastCollision(pole), effects.StrainLimit(0.1), effects.SelfCollision(), effects.Tearing(0.05), integrator=method
    )
    sim = run(scene, 500)
    assert np.abs(sim.positions).max() < 10.0  # not NaN either
    strain = diagnostics.strain(scene.lattice, sim.positions)
    assert np.quantile(strain, 0.9) < 0.1
    assert np.hypot(*sim.positions[..., 1:, :2].transpose(4, 0, 1, 2, 3)).min() >= pole * (1 - 1e-9)
    other = Simulator(scene, copies=2, threads=1)
    other.set_state(sim.get_state())
    for each in (sim, other):
        each.step(100)
    for name in ("positions", "velocities"):
        np.testing.assert_array_equal(getattr(sim, name), getattr(other, name))


def test_the_pole_has_the_last_word_whatever_the_order():
    kinds = [effects.MastCollision(), effects.Gravity(), effects.SelfCollision(), effects.StrainLimit()]
    held = [type(effect).__name__ for effect in Scene(flag().lattice, tuple(kinds)).effects]
    assert held == ["Gravity", "StrainLimit", "SelfCollision", "MastCollision"]
    assert flag(*kinds).effects[-1] == effects.MastCollision()
    assert flag(*kinds).adding(effects.Structural()).effects[-1] == effects.MastCollision()


@every_projection
def test_the_step_limit_is_that_without_it(effect):
    assert max_timestep(flag(effect)) == max_timestep(flag())
