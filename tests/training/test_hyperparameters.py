"""The hyperparameter files are rl-zoo3's, and make models."""

import pytest
import yaml
from torch import nn

from flag_env.envs.config import EPISODE_STEPS
from training.hyperparameters import FOLDER, parse_keywords, read, shipped
from training.train import Arguments, start

FILES = sorted(FOLDER.glob("*.yml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_files_have_the_keys_of_rl_zoo3(path):
    entry = yaml.safe_load(path.read_text(encoding="utf-8"))["Flag-v0"]
    assert {"n_timesteps", "policy", "n_envs"} <= set(entry)
    assert isinstance(entry["policy_kwargs"], str)  # rl-zoo3 evaluates a text


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_files_make_models(path):
    hyper = read(path, "Flag-v0")
    algo, _, kind = path.stem.partition("-")
    control, level = ("mast", "breeze") if kind == "mast" else ("wind", kind or "breeze")
    model = start(Arguments(algo=algo, control=control, level=level), hyper)
    assert model.n_envs == hyper.n_envs
    for name in ("gamma", "batch_size"):
        assert getattr(model, name) == hyper.algorithm[name]
    model.get_env().close()


def test_each_algorithm_has_a_file_and_the_mast_one_of_its_own():
    assert [path.stem for path in FILES] == ["ppo-mast", "ppo-snap", "ppo-wave", "ppo", "sac"]
    assert [shipped("ppo", *task).stem for task in (("wind", "storm"), ("both", "wave"), ("mast", "whip"))] == [
        *("ppo-wave", "ppo-wave", "ppo-snap")
    ]
    assert [shipped(*task).stem for task in (("ppo", "wind"), ("ppo", "mast"), ("sac", "wind"), ("sac", "mast"))] == [
        *("ppo", "ppo-mast", "sac", "sac")
    ]


def test_the_default_rollouts_are_whole_episodes_in_whole_minibatches():
    hyper = read(FOLDER / "ppo.yml", "Flag-v0")
    assert hyper.algorithm["n_steps"] == EPISODE_STEPS
    assert hyper.n_envs * EPISODE_STEPS % hyper.algorithm["batch_size"] == 0


def test_given_numbers_take_the_place_of_the_files():
    assert read(FOLDER / "ppo.yml", "Flag-v0").n_envs == 256
    hyper = read(FOLDER / "ppo.yml", "Flag-v0", total_timesteps=7, n_envs=3)
    assert (hyper.total_timesteps, hyper.n_envs) == (7, 3)


def test_an_unknown_id_is_named():
    with pytest.raises(ValueError, match="got 'Flag-v9'"):
        read(FOLDER / "ppo.yml", "Flag-v9")


def test_keywords_are_read_not_executed():
    assert parse_keywords("dict(a=-0.5, b=[1, 2], c=nn.ReLU, d=dict(pi=[3]))") == {
        **{"a": -0.5, "b": [1, 2], "c": nn.ReLU},
        "d": {"pi": [3]},
    }
    for text in ("print(1)", "dict(a=__import__('os').getcwd())", "dict(1)"):
        with pytest.raises(ValueError, match=r"dict\(name=value|malformed"):
            parse_keywords(text)
