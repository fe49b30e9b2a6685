"""Planning with gradients: targets are reached, and the actions do in the environment what the plan says."""

import gymnasium
import numpy as np
import pytest

from flag_env.envs.config import FlagConfig
from flag_env.tasks import HOLD
from training.plan import main, summary
from training.planning import Plan, Planner


@pytest.mark.parametrize("control", ["wind", "mast"])
def test_plans_reach_their_targets_in_the_environment(control):
    planner = Planner(FlagConfig(control=control, split="validation"), goal=0.05, seconds=20.0)
    env = gymnasium.make("Flag-v0", control=control, level="breeze", split="validation")
    for target in (0, 1):
        plan = planner.by_gradient(target)
        assert plan.distance < 0.05
        env.reset(options={"target": target})
        distances = [env.step(action)[4]["distance"] for action in plan.actions]
        assert max(distances[-HOLD.steps :]) == pytest.approx(plan.distance, rel=1e-4)  # actions in float32
    env.close()


def test_cross_entropy_gets_nearer_than_doing_nothing():
    planner = Planner(FlagConfig(split="validation"), goal=1e-3, seconds=0.3)
    still = planner._one
    still.begin([3])
    plan = planner.by_cross_entropy(3)
    assert plan.distance < still.run(np.zeros(still.shape))[-HOLD.steps :].max()
    assert np.abs(plan.actions).max() <= 1.0


def test_a_summary_counts_what_is_reached():
    plans = [Plan(np.zeros((1, 1)), distance, 1.0, 2) for distance in (0.01, 0.02, 0.1)]
    assert summary(plans, 0.03)["reached"] == pytest.approx(2 / 3)


def test_bad_arguments_are_refused_in_words():
    with pytest.raises(SystemExit, match="targets must"):
        main(targets=1000)
    with pytest.raises(SystemExit, match="goal must"):
        main(goal=-1.0)
