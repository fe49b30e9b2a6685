"""Success is counted as promised, on every target that was asked for."""

import zipfile
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from stable_baselines3.common.save_util import data_to_json, load_from_zip_file

from training import train
from training.baselines import BASELINES, Random, Zero
from training.environments import Task, evaluation_envs
from training.evaluate import ALGORITHMS, evaluate, load, table
from training.rollouts import Agent, rollout, summary


class Constant(Zero):
    """Always the same action."""

    def act(self, observations):
        return np.full(self._shape, 0.5, np.float32)


def test_success_must_hold_for_the_last_ten_steps():
    distances = np.full((6, 75), 0.2)
    distances[0, -10:] = 0.029  # succeeds at 3 % and 5 %
    distances[1, -10:] = 0.049  # at 5 %
    distances[2, -10:] = 0.05  # touches the tolerance
    distances[3, -9:] = 0.01  # a step too late
    distances[4, 10:] = 0.01
    distances[4, -1] = 0.06  # leaves at the end
    distances[5, 20:] = np.inf  # diverges
    assert summary(distances) == {
        "success_5": pytest.approx(2 / 6),
        "success_3": pytest.approx(1 / 6),
        "median_distance": pytest.approx((0.049 + 0.05) / 2),
    }


def test_the_median_of_mostly_diverged_episodes_is_none():
    assert summary(np.full((3, 75), np.inf)) == {"success_5": 0.0, "success_3": 0.0, "median_distance": None}


def test_rollouts_are_the_episodes_of_the_single_environment():
    task, targets = Task(), [3, 0, 7]  # two environments, three targets: the last round is half empty
    found = rollout(Constant(task, "validation"), evaluation_envs(task, 2, "validation"), targets)
    env = gymnasium.make("Flag-v0", split="validation")
    for row, target in zip(found, targets, strict=True):
        env.reset(options={"target": target})
        wanted = []
        ended = False
        while not ended:
            *_, terminated, truncated, info = env.step(np.full(3, 0.5, np.float32))
            wanted.append(info["distance"])
            ended = terminated or truncated
        np.testing.assert_array_equal(row, wanted)


def test_evaluation_has_its_schema():
    task = Task(control="mast", level="calm")
    result = evaluate({name: BASELINES[name](task, "test") for name in ("zero", "random")}, task, "test", episodes=3)
    assert result["task"] == {"env_id": "Flag-v0", "control": "mast", "level": "calm", "accuracy": "balanced"}
    assert (result["split"], result["episodes"], result["hold_steps"]) == ("test", 3, 10)
    assert result["tolerances"] == {"success_5": 0.05, "success_3": 0.03}
    assert set(result["policies"]) == {"zero", "random"}
    for figures in result["policies"].values():
        assert set(figures) == {"success_5", "success_3", "median_distance"}
        assert 0 <= figures["success_3"] <= figures["success_5"] <= 1
    lines = table(result).splitlines()
    assert len(lines) == 4
    assert len({len(line) for line in lines[1:]}) == 1


def test_random_is_the_same_at_every_evaluation():
    actions = []
    for _ in range(2):
        policy = Random(Task(), "validation")
        policy.begin(np.arange(4))
        actions.append(policy.act(np.zeros((4, 1), np.float32)))
    np.testing.assert_array_equal(*actions)
    assert np.abs(actions[0]).max() <= 1


class Payload:
    """What a hostile author may put into a model file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_loading_reads_weights_and_runs_no_stored_code(tiny, tmp_path, algo):
    arguments = tiny(algo, total_timesteps=120)
    train.run(arguments)
    path, trap = arguments.folder / "model.zip", tmp_path / "trap"
    model = ALGORITHMS[algo].load(path, device="cpu")
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    content["data"] = data_to_json({"policy_class": Payload(trap)}).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, part in content.items():
            archive.writestr(name, part)
    task, policy = load(arguments.folder)
    assert task == arguments.task
    assert not trap.exists()
    observation = np.random.default_rng(0).uniform(-1, 1, (5, *model.observation_space.shape)).astype(np.float32)
    expected = model.predict(observation, deterministic=True)[0]
    np.testing.assert_array_equal(Agent(policy).act(observation), expected)
    load_from_zip_file(path)  # what stable-baselines3's own loading does
    assert trap.exists()


def test_a_folder_without_a_finished_training_is_refused_by_name(tmp_path):
    with pytest.raises(FileNotFoundError, match=rf"folder of a finished training.*got {tmp_path}"):
        load(tmp_path)
