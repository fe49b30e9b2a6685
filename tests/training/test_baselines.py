"""What the baselines are known to reach."""

import numpy as np
import pytest

from flag_env.physics.runtime.mast import mast_points
from flag_env.tasks.targets import load_targets
from training.baselines import Lookup, PControl, mast_pose
from training.environments import Task, evaluation_envs
from training.rollouts import begin, rollout, summary

TASKS = [Task(control=control, level=level) for control in ("wind", "mast") for level in ("calm", "breeze")]


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_witnesses_of_training_targets_reach_them(task):
    targets = range(0, 768, 96)
    distances = rollout(Lookup(task, "train"), evaluation_envs(task, len(targets), "train"), targets)
    assert summary(distances)["success_3"] == 1.0


def test_a_mast_pose_is_read_off_its_points():
    rng = np.random.default_rng(0)
    rest = np.stack([np.zeros(10), np.zeros(10), np.linspace(0, 1, 10)], axis=1)
    position, tilt = rng.uniform(-1, 1, (50, 3)), rng.uniform(-0.6, 0.6, (50, 2))
    found = mast_pose(mast_points(rest, position, tilt, np.zeros(50)))
    np.testing.assert_allclose(found, np.concatenate([position, tilt], axis=1), atol=1e-14)


def test_p_control_brings_the_mast_to_the_targets_mast():
    task = Task(control="mast", level="calm")
    envs = evaluation_envs(task, 4, "validation")
    policy = PControl(task, "validation")
    observations = begin(envs, np.arange(4))
    policy.begin(np.arange(4))
    for _ in range(74):
        observations = envs.step(policy.act(observations))[0]
    masts = envs.unwrapped.simulator.positions[:, 0, :, 0]
    goals = load_targets("mast", "calm", "validation").positions[:4, 0, :, 0]
    np.testing.assert_allclose(masts, goals, atol=0.01)


def test_p_control_is_for_the_mast():
    with pytest.raises(ValueError, match="'mast'"):
        PControl(Task(), "validation")
