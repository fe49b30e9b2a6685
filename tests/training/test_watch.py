"""A trained agent is watched in the live page and recorded, by the commands that a user types."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from websockets.sync.client import connect

from flag_env import cli
from tests.conftest import ROOT
from training import train
from training.evaluate import load
from training.record import watched


@pytest.fixture
def run(tiny):
    """Folder of a finished training."""
    arguments = tiny()
    train.run(arguments)
    return arguments.folder


def test_what_is_watched_acts_as_the_agent_does(run):
    task, act = watched(run)
    assert (task.env_id, task.control, task.split) == ("Flag-v0", "wind", "test")
    env = task.make()
    observation, _ = env.reset(seed=0)
    expected, _ = load(run)[1].predict(observation, deterministic=True)
    np.testing.assert_array_equal(act(observation), expected)
    env.close()


def test_play_shows_the_agent(run):
    command = [sys.executable, "-c", "from flag_env.cli import main; main()", "play", "--agent", str(run), "--target", "7"]
    options = ["--port", "0", "--no-browser"]
    with subprocess.Popen([*command, *options], cwd=ROOT, stdout=subprocess.PIPE, text=True) as play:
        try:
            address = re.match(r"http://(127\.0\.0\.1:\d+)/", play.stdout.readline())[1]
            with connect(f"ws://{address}/socket", origin=f"http://{address}", max_size=None) as page:
                while True:
                    text = page.recv(timeout=120)
                    if isinstance(text, str) and (status := json.loads(text))["type"] == "status":
                        break
        finally:
            play.terminate()
    assert (status["mode"], status["episode"]["driver"], status["episode"]["target"]) == ("watch", "agent", 7)
    assert status["episode"]["reference"]["who"] == "agent"


def test_an_agents_episode_is_recorded(run, tmp_path):
    cli.record(agent=run, target=7, output=tmp_path / "agent.html")
    assert "a trained agent, target 7 of test" in (tmp_path / "agent.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", [cli.play, cli.record])
def test_a_folder_without_a_training_is_refused_in_words(command, tmp_path):
    with pytest.raises(SystemExit, match="a run must be a folder of a finished training"):
        command(agent=tmp_path)


@pytest.mark.parametrize("stage", ["report-1", "report-2"])
@pytest.mark.parametrize("suffix", ["html", "gif"])
def test_the_reports_videos_are_recorded_by_one_command_each(stage, suffix, tmp_path):
    path = tmp_path / f"video.{suffix}"
    cli.record(stage, path, seconds=0.2)
    assert path.read_bytes().startswith(b"GIF89a" if suffix == "gif" else b"<!doctype html>")
