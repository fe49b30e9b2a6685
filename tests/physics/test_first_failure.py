"""`Diverged` names the particle that went first and the time, as going step by step from the start does."""

import numpy as np
import pytest

from flag_env.physics import Diverged, Simulator, effects, max_timestep, presets
from flag_env.physics.integrators import LFAB, Leapfrog

FLAG = presets.flag(6, 7)
CALM = FLAG.without(effects.CosineWind)
CASES = {
    "too large a step": (CALM.replace(timestep=1.3 * max_timestep(CALM), allow_unstable=True), None),
    "another method": (
        CALM.replace(integrator=LFAB(), timestep=2.5 * max_timestep(CALM), allow_unstable=True, dtype="float32"),
        None,
    ),
    "a shot": (FLAG.replace(integrator=Leapfrog()), (0, 4, 5)),
    "a storm": (presets.flag(4, 5).without(effects.CosineWind).adding(effects.Gusts(2.0), effects.AirDrag(1e4)), None),
}
CASES["a storm"] = (
    CASES["a storm"][0].replace(timestep=1.2 * max_timestep(CASES["a storm"][0]), allow_unstable=True),
    None,
)


def made(case, copies=3):
    scene, shot = CASES[case]
    sim = Simulator(scene, copies=copies, seed=2)
    if shot:
        velocities = np.zeros(sim.velocities.shape)
        velocities[1][shot] = 1e308, -1e308, 1e308
        sim.set_velocities(velocities)
    return sim


def brute_force(case, act):
    """First failure of a simulator that goes step by step: time, copy and particle."""
    sim = made(case)
    act(sim)
    for _ in range(20_000):
        try:
            sim.step(1)
        except Diverged as error:
            return error
    raise AssertionError("it did not diverge")


def at_rest(sim):
    pass


def windy(sim):
    if sim.scene.effects and any(hasattr(effect, "unit") for effect in sim.scene.effects):
        sim.set_wind(mean=(0.1, 0.2, 0.0))


def steps(sim, n):
    for _ in range(20_000):
        sim.step(n)


@pytest.mark.parametrize("case", CASES)
def test_the_particle_that_went_first_is_named(case):
    for act in (at_rest, windy):
        expected = brute_force(case, act)
        for n in (20_000, 64, 7):
            sim = made(case)
            act(sim)
            with pytest.raises(Diverged) as caught:
                steps(sim, n)
            found = caught.value
            assert (found.copy, found.particle) == (expected.copy, expected.particle)
            assert found.time == pytest.approx(expected.time, rel=1e-12)
            lattice = sim.scene.lattice
            assert not lattice.fixed.reshape(lattice.shape)[found.particle]


def test_what_stopped_stays_as_it_stopped_and_the_others_go_on():
    sim, healthy = made("a shot"), Simulator(CASES["a shot"][0], copies=3, seed=2)
    sim.step_into(70, sim.frame())
    stopped = sim.get_state()
    assert sim.diverged.tolist() == [False, True, False]
    again = made("a shot")
    with pytest.raises(Diverged):
        again.step(70)
    healthy.step(70)
    for a, b in zip(stopped.arrays(), again.get_state().arrays(), strict=True):
        if a is not stopped.failed_particle:
            np.testing.assert_array_equal(a, b)
    for copy in (0, 2):
        np.testing.assert_array_equal(again.positions[copy], healthy.positions[copy])


def lead(sim):
    for step in range(1, 201):
        sim.set_mast(np.array([0.2, 0.0, 0.1]) * step / 200, tilt=np.array([0.1, 0.2]) * step / 200)
        sim.step(1)


def test_a_moving_mast_is_moved_again():
    """Up to rounding: the particle and the step are those of a run whose mast is led by hand, step by step."""
    sim, by_hand = made("a shot"), made("a shot")
    sim.set_mast((0.2, 0.0, 0.1), tilt=(0.1, 0.2))
    with pytest.raises(Diverged) as caught:
        sim.step(200)
    with pytest.raises(Diverged) as expected:
        lead(by_hand)
    assert caught.value.particle == expected.value.particle
    assert caught.value.time == pytest.approx(expected.value.time, rel=1e-12)
