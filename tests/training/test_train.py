"""A training leaves what it promises; interrupted, it goes on from its last checkpoint to the same bits."""

import functools
import importlib
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import tyro
from stable_baselines3.common.callbacks import BaseCallback

from flag_env._files import read_json
from training import checkpoint, hyperparameters, run_folder, train
from training.evaluate import ALGORITHMS
from training.train import run

ROLLOUT = 128
"""Timesteps of a rollout of the tiny training."""

KILLED_AT = 300


class Interrupt(BaseCallback):
    """Raises in the middle of a rollout."""

    def __init__(self, at: int) -> None:
        super().__init__()
        self.at = at

    def _on_step(self) -> bool:
        if self.num_timesteps >= self.at:
            raise KeyboardInterrupt
        return True


class Kill(Interrupt):
    """Ends the process with no chance to clean up."""

    def _on_step(self) -> bool:
        if self.num_timesteps >= self.at:
            os.kill(os.getpid(), signal.SIGKILL)
        return True


def weights(folder: Path, algo: str = "ppo") -> dict[str, torch.Tensor]:
    return ALGORITHMS[algo].load(folder / "model.zip", device="cpu").policy.state_dict()


def assert_same_run(one: Path, other: Path, algo: str = "ppo") -> None:
    for name, weight in weights(one, algo).items():
        assert torch.equal(weight, weights(other, algo)[name]), name
    assert read_json(one / "learning_curve.json") == read_json(other / "learning_curve.json")
    results = [read_json(folder / "evaluation.json") for folder in (one, other)]
    for result in results:
        del result["seconds"]
    assert results[0] == results[1]


def test_a_training_leaves_its_files(tiny, monkeypatch):
    monkeypatch.setattr(train, "record", functools.partial(train.record, every=75, size=64))
    arguments = tiny(record=True)
    result = run(arguments)
    folder = arguments.output / "Flag-v0-ppo-0"
    assert {path.name for path in folder.iterdir()} == {
        *("model.zip", "evaluation.json", "learning_curve.json", "learning_curve.png", "agent.gif", "agent.html"),
        *("arguments.json", "tensorboard", "checkpoints", ".lock"),
    }
    assert read_json(folder / "evaluation.json") == result
    assert result["timesteps"] == 512
    assert [point["timesteps"] for point in read_json(folder / "learning_curve.json")] == [0, 256, 512]
    assert [path.name for path in checkpoint.paths(folder / "checkpoints")] == ["000000384.checkpoint", "000000512.checkpoint"]
    assert list((folder / "tensorboard").glob("events.out.tfevents.*"))
    assert (folder / "agent.gif").read_bytes()[:3] == b"GIF"
    assert (folder / "learning_curve.png").read_bytes()[1:4] == b"PNG"
    described = read_json(folder / "arguments.json")
    assert described["arguments"]["seed"] == 0
    assert described["hyperparameters"]["algorithm"]["n_steps"] == 64
    assert {"python", "numpy", "numba", "gymnasium", "stable_baselines3", "torch", "flag_env"} <= set(
        described["machine"]["versions"]
    )


@pytest.mark.linux
def test_a_killed_training_resumes_to_the_same_bits(tiny, tmp_path):
    whole, broken = tiny(output="whole"), tiny(output="broken")
    run(whole)
    (tmp_path / "arguments.pickle").write_bytes(pickle.dumps(broken))
    script = (
        "import pickle, sys; from pathlib import Path; from training.train import run\n"
        "from tests.training.test_train import KILLED_AT, Kill\n"
        "run(pickle.loads(Path(sys.argv[1]).read_bytes()), (Kill(KILLED_AT),))"
    )
    process = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "arguments.pickle")],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        check=False,
        timeout=300,
    )
    assert process.returncode == -signal.SIGKILL, process.stderr.decode()
    newest = int(checkpoint.paths(broken.folder / "checkpoints")[-1].stem)
    assert KILLED_AT - ROLLOUT <= newest <= KILLED_AT
    assert not (broken.folder / "model.zip").exists()
    run(tiny(output="broken", resume=True))
    assert_same_run(whole.folder, broken.folder)


def test_an_interrupted_training_resumes_to_the_same_bits(tiny, monkeypatch):
    monkeypatch.setitem(train.CHECKPOINT_EVERY, "sac", 50)
    whole = tiny("sac", output="whole")
    run(whole)
    with pytest.raises(KeyboardInterrupt):
        run(tiny("sac", output="broken"), (Interrupt(190),))
    resumed = tiny("sac", output="broken", resume=True)
    run(resumed)
    assert_same_run(whole.folder, resumed.folder, "sac")


def test_a_training_that_was_interrupted_before_its_first_checkpoint_starts_anew(tiny):
    with pytest.raises(KeyboardInterrupt):
        run(tiny(), (Interrupt(10),))
    assert run(tiny(resume=True))["timesteps"] == 512


def test_a_finished_training_is_not_repeated(tiny):
    first = run(tiny(total_timesteps=128))
    assert run(tiny(total_timesteps=128, resume=True), (Interrupt(0),)) == first


def test_total_timesteps_are_rounded_up_to_whole_rollouts(tiny):
    assert run(tiny(total_timesteps=130))["timesteps"] == 2 * ROLLOUT


def test_the_learning_curve_ends_with_what_the_evaluation_finds(tiny):
    arguments = tiny(total_timesteps=128, validation_episodes=3)
    agent = run(arguments)["policies"]["agent"]
    assert read_json(arguments.folder / "learning_curve.json")[-1] == {"timesteps": 128, **agent}


def test_seeds_differ(tiny):
    one, other = tiny(total_timesteps=128), tiny(total_timesteps=128, seed=1)
    run(one)
    run(other)
    assert one.folder != other.folder
    assert any(not torch.equal(weight, weights(other.folder)[name]) for name, weight in weights(one.folder).items())


@pytest.mark.parametrize("broken", [b"", b"\x80\x04\x95"])
def test_a_broken_checkpoint_falls_back_to_the_one_before(tiny, broken):
    arguments = tiny(total_timesteps=256)
    run(arguments)
    folder = arguments.folder / "checkpoints"
    checkpoint.paths(folder)[-1].write_bytes(broken)
    with pytest.warns(UserWarning, match="cannot be read"):
        loaded = checkpoint.load(folder, ALGORITHMS["ppo"], "cpu")
    assert loaded is not None
    assert loaded[0].num_timesteps == 128
    assert np.isfinite(loaded[0].policy.log_std.detach().numpy()).all()


def test_a_training_whose_checkpoints_are_all_broken_is_not_begun_anew_in_silence(tiny):
    arguments = tiny(total_timesteps=256)
    run(arguments)
    (arguments.folder / "evaluation.json").unlink()
    for path in checkpoint.paths(arguments.folder / "checkpoints"):
        path.write_bytes(b"garbage")
    with pytest.warns(UserWarning, match="cannot be read"), pytest.raises(ValueError, match="none of the 2 checkpoints"):
        run(tiny(total_timesteps=256, resume=True))


def test_a_finished_training_is_extended(tiny):
    first = run(tiny(total_timesteps=256))
    curve = read_json(tiny().folder / "learning_curve.json")
    longer = tiny(total_timesteps=512, resume=True)
    second = run(longer)
    assert (first["timesteps"], second["timesteps"]) == (256, 512)
    assert read_json(longer.folder / "learning_curve.json")[: len(curve)] == curve
    assert read_json(longer.folder / "arguments.json")["extended_from"] == [256]
    assert run(longer, (Interrupt(0),)) == second
    with pytest.raises(ValueError, match="total_timesteps"):
        run(tiny(total_timesteps=256, resume=True))


def test_an_interrupted_extension_resumes_to_the_same_bits(tiny):
    whole, broken = (tiny(output=output, total_timesteps=512, resume=True) for output in ("whole", "broken"))
    for output in ("whole", "broken"):
        run(tiny(output=output, total_timesteps=256))
    run(whole)
    with pytest.raises(KeyboardInterrupt):
        run(broken, (Interrupt(400),))
    assert read_json(broken.folder / "evaluation.json")["timesteps"] == 256  # the old result stands until there is a new one
    run(broken)
    assert_same_run(whole.folder, broken.folder)


def test_an_unfinished_training_is_not_extended(tiny):
    with pytest.raises(KeyboardInterrupt):
        run(tiny(total_timesteps=512), (Interrupt(300),))
    with pytest.raises(ValueError, match=r"total_timesteps must be 512.*got 1024"):
        run(tiny(total_timesteps=1024, resume=True))
    assert run(tiny(total_timesteps=512, resume=True))["timesteps"] == 512


def test_a_run_in_progress_is_refused_to_a_second_process(tiny, tmp_path):
    arguments = tiny(total_timesteps=128)
    told: list[tuple[int, str]] = []

    class Second(Interrupt):
        """Starts the same run, in another process, while this one is at work."""

        def _on_step(self) -> bool:
            if not told:
                for flag in ("resume", "overwrite"):
                    (tmp_path / "second.pickle").write_bytes(pickle.dumps(tiny(total_timesteps=128, **{flag: True})))
                    script = (
                        "import pickle, sys; from pathlib import Path; from training.train import run\n"
                        "run(pickle.loads(Path(sys.argv[1]).read_bytes()))"
                    )
                    command = [sys.executable, "-c", script, str(tmp_path / "second.pickle")]
                    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
                    told.append((done.returncode, done.stderr))
            return True

    assert run(arguments, (Second(0),))["timesteps"] == 128
    assert [code for code, _ in told] == [1, 1]
    assert all("is in use by another process" in error for _, error in told)
    assert read_json(arguments.folder / "evaluation.json")["timesteps"] == 128


BAD = {
    "total_timesteps": (0, -1),
    "n_envs": (0, -2),
    "validations": (0, -1),
    "validation_episodes": (0, 129),
    "evaluation_episodes": (0, 129),
    "seed": (-1, 2**32),
    "algo": ("dqn",),
    "control": ("sea",),
    "level": ("hurricane",),
    "accuracy": ("wrong", 0.0, float("nan")),
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in BAD.items() for value in values])
def test_bad_arguments_are_named_before_anything_is_made(tiny, tmp_path, name, value):
    with pytest.raises(ValueError, match=name):
        tiny(**{name: value}) if name != "algo" else train.Arguments(algo=value, output=tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


BAD_FILES = {
    "no timesteps": ("Flag-v0:\n  policy: MlpPolicy\n", "n_timesteps"),
    "zero timesteps": ("Flag-v0:\n  policy: MlpPolicy\n  n_timesteps: 0\n", "n_timesteps"),
    "half an environment": ("Flag-v0:\n  policy: MlpPolicy\n  n_timesteps: 128\n  n_envs: 0.5\n", "n_envs"),
    "no policy": ("Flag-v0:\n  n_timesteps: 128\n", "policy"),
    "unknown policy": ("Flag-v0:\n  policy: Policy\n  n_timesteps: 128\n", "Policy Policy unknown"),
    "unknown argument": ("Flag-v0:\n  policy: MlpPolicy\n  n_timesteps: 128\n  learning_ratee: 1\n", "learning_ratee"),
    "batch of one": ("Flag-v0:\n  policy: MlpPolicy\n  n_timesteps: 128\n  batch_size: 1\n", "batch_size"),
    "another environment": ("CartPole-v1:\n  policy: MlpPolicy\n", "env_id"),
    "no mapping": ("- 1\n", "env_id"),
    "no YAML": ("Flag-v0: [", "YAML"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_hyperparameters_are_named_before_anything_is_made(tiny, case):
    content, named = BAD_FILES[case]
    arguments = tiny(total_timesteps=None)
    assert arguments.hyperparameters is not None
    good = arguments.hyperparameters.read_text()
    arguments.hyperparameters.write_text(content)
    with pytest.raises(ValueError, match=named):
        run(arguments)
    assert not arguments.output.exists()
    arguments.hyperparameters.write_text(good)
    run_folder.check(arguments.folder, arguments, hyperparameters.read(arguments.hyperparameters, "Flag-v0"))  # may start now


def test_a_device_that_is_not_there_leaves_no_folder(tiny):
    with pytest.raises(ValueError, match="device"):
        run(tiny(device="nonsense"))
    assert not tiny().output.exists()


@pytest.mark.parametrize(
    ("module", "arguments", "named"),
    [
        ("train", ("--total-timesteps", "0"), "total_timesteps must be at least 1"),
        ("train", ("--output", "FILE"), "output must be a folder"),
        ("benchmark", ("--seeds", "0", "0"), "seeds must be"),
        ("benchmark", ("--results", "FILE/x.json"), "results must be a folder"),
        ("accuracy_cost", ("--validations", "0"), "validations must be at least 1"),
        ("vector_speed", ("--total-timesteps", "0"), "total_timesteps must be at least 1"),
        ("vector_speed", ("--results", "FILE/x.json"), "results must be a folder"),
        ("record", ("FILE", "--every", "0", "--output", "x.gif"), "every must be at least 1"),
        ("record", ("FILE", "--size", "-3", "--output", "x.gif"), "size must be at least 64"),
        ("record", ("FILE", "--output", "x.webm"), "output must be a name that ends in .gif or .mp4"),
        ("evaluate", ("--output", "FILE/x.json"), "output must be a folder"),
        ("evaluate", ("FILE",), "run must be a folder of a finished training"),
        ("evaluate", ("--baselines", "p_control"), "control must be 'mast'"),
        ("rllib_train", ("--envs-per-runner", "0"), "envs_per_runner must be at least 1"),
        ("rllib_train", ("--batch", "1"), "batch must be at least 400"),
        ("rllib_train", ("--output", "FILE"), "output must be a folder"),
    ],
)
def test_commands_refuse_in_words_before_any_work(tmp_path, monkeypatch, capsys, module, arguments, named):
    (tmp_path / "FILE").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [module, *arguments])
    loaded = importlib.import_module(f"training.{module}")
    started = {"record": "main", "evaluate": "main", "rllib_train": "Arguments"}.get(module)
    with pytest.raises(SystemExit) as ended:
        loaded.main() if started is None else tyro.cli(getattr(loaded, started))
    told = capsys.readouterr().err + str(ended.value)
    assert named in " ".join(told.replace("│", " ").split())  # tyro puts errors into a box
    assert [path.name for path in tmp_path.iterdir()] == ["FILE"]
