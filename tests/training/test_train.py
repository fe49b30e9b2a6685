"""A training leaves what it promises; interrupted, it goes on from its last checkpoint to the same bits."""

import functools
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import BaseCallback

from training import checkpoint, train
from training.evaluate import ALGORITHMS
from training.files import read_json
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
    monkeypatch.setattr(train, "record", functools.partial(train.record, every=75, size=32))
    arguments = tiny(record=True)
    result = run(arguments)
    folder = arguments.output / "Flag-v0-ppo-0"
    assert {path.name for path in folder.iterdir()} == {
        *("model.zip", "evaluation.json", "learning_curve.json", "learning_curve.png", "agent.gif", "arguments.json"),
        *("tensorboard", "checkpoints"),
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
    assert {"python", "numpy", "numba", "gymnasium", "stable-baselines3", "torch", "flag_env", "machine"} <= set(
        described["versions"]
    )


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
