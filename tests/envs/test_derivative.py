"""Episodes as functions of their actions: the environments' own distances, and derivatives against differences."""

import numpy as np
import pytest

from flag_env.envs.batch import FlagBatch, FlagConfig
from flag_env.envs.derivative import DifferentiableEpisodes
from flag_env.physics import effects, integrators, presets

SMOOTH = {"wind": "breeze", "mast": "breeze", "both": "wave"}
"""Controls that have derivatives, and a level of each."""

STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))


@pytest.mark.parametrize("control", SMOOTH)
def test_distances_are_those_of_the_environment(control):
    config, rng = FlagConfig(control=control, level=SMOOTH[control]), np.random.default_rng(0)
    episodes, batch = DifferentiableEpisodes(config, 2), FlagBatch(config, 2)
    episodes.begin([3, 5])
    batch.reset(range(2), [3, 5])
    actions = rng.uniform(-1.3, 1.3, episodes.shape)
    found = episodes.run(actions)
    for step, action in enumerate(actions):
        batch.step(action, action.shape)
        np.testing.assert_allclose(found[step], batch.distance, rtol=1e-12)


def small(control):
    """A coarse flag in float64, on which targets are where witnesses lead."""
    scene = presets.flag(rows=4, cols=5, stiffness=60.0, integrator=integrators.LFAB(), timestep=4e-3)
    return DifferentiableEpisodes(FlagConfig(control=control, level=SMOOTH[control], scene=scene), 2)


@pytest.mark.parametrize("control", SMOOTH)
def test_derivatives_by_actions_agree_with_differences(control):
    episodes, rng = small(control), np.random.default_rng(1)
    episodes.begin([1, 2])
    steps = 12
    actions = rng.uniform(-0.9, 0.9, (steps, *episodes.shape[1:]))
    actions[2, 0] = 1.5  # clipped: counts for nothing
    weights = rng.standard_normal((steps, 2))
    episodes.run(actions)
    by = episodes.pull_back(weights)
    assert not by[2, 0].any()
    direction = 3e-3 * rng.standard_normal(actions.shape)
    along = sum(
        c * ((episodes.run(actions + k * direction) - episodes.run(actions - k * direction)) * weights).sum() for k, c in STENCIL
    )
    np.testing.assert_allclose((by * direction).sum(), along, rtol=1e-8)


def test_a_mast_at_its_stop_does_not_move():
    episodes = small("mast")
    actions = np.ones((40, 2, 5))
    episodes.run(actions)
    by = episodes.pull_back(np.ones((40, 2)))
    np.testing.assert_array_equal(by[-1, :, :3], 0.0)
    assert by[0].any()


def test_rewards_follow_their_distances():
    episodes, rng = small("wind"), np.random.default_rng(2)
    actions, weights = rng.uniform(-0.9, 0.9, (6, 2, 3)), rng.standard_normal((6, 2))
    episodes.run(actions)
    by_reward = episodes.pull_back_rewards("shaped", weights)
    by_distance = -3.0 * 0.98 * weights
    by_distance[:-1] += 3.0 * weights[1:]
    np.testing.assert_allclose(by_reward, episodes.pull_back(by_distance), rtol=1e-12)
    np.testing.assert_allclose(episodes.pull_back_rewards("dense", weights), episodes.pull_back(-weights), rtol=1e-12)
    with pytest.raises(ValueError, match="reward must be one of"):
        episodes.pull_back_rewards("sparse", weights)


def test_what_is_not_smooth_is_refused():
    with pytest.raises(ValueError, match="control must define drive and drive_back"):
        DifferentiableEpisodes(FlagConfig(control="wind+frequency", level="wave"), 1)
    scene = presets.flag(rows=4, cols=5, integrator=integrators.LFAB()).adding(effects.SelfCollision())
    with pytest.raises(ValueError, match="SelfCollision"):
        DifferentiableEpisodes(FlagConfig(scene=scene), 1)
