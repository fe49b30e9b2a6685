"""Reviewed trajectories of the released environments: a silent change of physics, observations or rewards fails here.

`digests.json` holds, for each id, control and level, an episode's last observation and sum of rewards, and a digest of all its
bits. The numbers must agree everywhere; the bits must agree where they were written (processor and versions): the cosine of
another one may round differently. After a reviewed change: `python tests/envs/test_digests.py`, and a new version of the id.
"""

import hashlib
import itertools
import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import flag_env  # noqa: F401
from flag_env._files import machine

PATH = Path(__file__).with_name("digests.json")
CASES = list(itertools.product(("Flag-v0", "FlagGoal-v0", "FlagGoalDense-v0"), ("wind", "mast"), ("calm", "breeze")))


def where() -> dict[str, str]:
    found = machine()
    return {"processor": found["processor"], **{name: found["versions"][name] for name in ("numpy", "numba")}}


def flat(observation):
    return np.concatenate(list(observation.values())) if isinstance(observation, dict) else observation


def episode(env_id, control, level):
    env = gymnasium.make(env_id, control=control, level=level)
    observation, _ = env.reset(seed=1, options={"target": 3})
    digest, total = hashlib.sha256(flat(observation).tobytes()), 0.0
    for action in np.random.default_rng(2).uniform(-1, 1, (75, env.action_space.shape[0])).repeat(5, axis=0)[:75]:
        observation, reward, *_ = env.step(action.astype(np.float32))
        digest.update(flat(observation).tobytes() + np.float64(reward).tobytes())
        total += reward
    return {"last": flat(observation).tolist(), "return": total, "digest": digest.hexdigest()}


@pytest.mark.parametrize("case", CASES, ids="-".join)
def test_a_released_trajectory_is_as_reviewed(case):
    reviewed = json.loads(PATH.read_text())
    known, found = reviewed["episodes"]["-".join(case)], episode(*case)
    np.testing.assert_allclose(found["last"], known["last"], rtol=0, atol=2e-4)  # float32, and 3 s of a mildly chaotic flag
    assert found["return"] == pytest.approx(known["return"], abs=1e-4)
    if where() == reviewed["where"]:
        assert found["digest"] == known["digest"]


if __name__ == "__main__":
    episodes = {"-".join(case): episode(*case) for case in CASES}
    for one in episodes.values():
        one["last"] = [round(value, 5) for value in one["last"]]
    PATH.write_text(json.dumps({"where": where(), "episodes": episodes}, separators=(",", ":")) + "\n")
