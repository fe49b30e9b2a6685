"""Episodes of the environment in a session."""

import json

import gymnasium
import numpy as np
import pytest

import flag_env  # noqa: F401  registers the ids
from flag_env.viewer import Session, Task
from flag_env.viewer.episode import EPISODE_STEPS, REST, Episode

TASK = {"control": "wind", "level": "breeze", "target": 3}


def test_a_witness_reaches_its_target_as_in_the_environment(session, order):
    assert order(session, "watch", driver="witness", **TASK) == ""
    for _ in range(EPISODE_STEPS):
        session.advance(0.04)
    status = session.status()["episode"]
    env = gymnasium.make("Flag-v0", control="wind", level="breeze", split="test").unwrapped
    env.reset(options={"target": 3})
    distances, total = [], 0.0
    for action in env.witness():
        _, reward, _, _, info = env.step(action)
        distances.append(info["distance"])
        total += reward
    assert status["success"]
    assert info["is_success"]
    np.testing.assert_allclose(status["distance"], distances, atol=1e-5)
    assert status["total"] == pytest.approx(total, abs=1e-2)
    assert status["reference"]["distance"] == status["distance"]
    np.testing.assert_allclose(np.reshape(session.describe()["target"], env.target.shape), env.target, atol=1e-4)


def test_the_hand_acts_and_is_scored_beside_the_witness(session, order):
    order(session, "watch", driver="hand", **TASK)
    assert order(session, "action", values=[1.0, 5.0, -1.0]) == ""
    for _ in range(10):
        session.advance(0.04)
    status = session.status()["episode"]
    assert status["action"] == [1.0, 1.0, -1.0]
    assert status["steps"] == 10
    assert len(status["reference"]["distance"]) == EPISODE_STEPS
    assert status["distance"] != status["reference"]["distance"][:10]
    assert "values must" in order(session, "action", values=[0.0])


def test_an_agent_acts_in_its_own_task(order):
    seen = []

    def agent(observation):
        seen.append(observation)
        return np.full(5, 0.5, np.float32)

    session = Session("flag", Task("mast", "calm"), agent, ("agent", 7))
    session.advance(0.04)
    status = session.status()["episode"]
    assert (status["driver"], status["target"], status["reference"]["who"]) == ("agent", 7, "agent")
    assert len(seen) == EPISODE_STEPS + 1  # the whole run that others are held against, and one step
    assert status["distance"] == status["reference"]["distance"][:1]
    session.close()


def test_the_next_target_follows_a_rest_and_the_last_the_first():
    episode = Episode(Task(), "witness", 127)
    for _ in range(round((3.0 + REST) / 0.04) + 2):
        episode.advance(0.04)
    assert episode.target == 0
    assert episode.version == 2
    episode.close()


def test_flying_again_ends_the_episode(session, order):
    order(session, "watch", driver="witness", **TASK)
    session.advance(0.1)
    version = session.version
    assert session.describe()["mode"] == "watch"
    order(session, "stage", name="flag")
    session.advance(0.1)
    assert session.describe()["mode"] == "fly"
    assert session.describe()["target"] is None
    assert session.version > version


@pytest.mark.parametrize("change", [{"driver": "agent"}, {"driver": "ghost"}, {"target": 128}, {"target": -1}, {"target": 1.5}])
def test_what_cannot_be_watched_is_told(session, order, change):
    refusal = order(session, "watch", **{**TASK, "driver": "witness", **change})
    session.advance(0.0)
    assert refusal or session.status()["message"]
    assert session.episode is None
    assert json.dumps(session.status())
