"""What the shaped reward's terms add up to over real episodes, as its description says."""

import gymnasium
import numpy as np
import pytest

import flag_env  # noqa: F401
from flag_env.tasks.reward import BONUS, DISCOUNT, SLOPE


@pytest.mark.parametrize("control", ["wind", "mast"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_approach_term_telescopes_over_an_episode(control, seed):
    """Discounted by 0.98, rewards come to bonuses + 3 d_0 - 0.66 d_75; undiscounted, to a sum over all distances."""
    env = gymnasium.make("Flag-v0", control=control)
    _, info = env.reset(seed=seed)
    rng, ended = np.random.default_rng(seed), False
    rewards, distances = [], [info["distance"]]
    action = np.zeros(env.action_space.shape, np.float32)
    while not ended:
        if len(rewards) % 10 == 0:
            action = rng.uniform(-1, 1, action.shape).astype(np.float32)
        _, reward, terminated, ended, info = env.step(action)
        assert not terminated
        rewards.append(reward)
        distances.append(info["distance"])
    d, n = np.array(distances), len(rewards)
    assert n == 75
    assert SLOPE * DISCOUNT**n == pytest.approx(0.66, abs=0.005)
    bonuses = BONUS * (d[1:] < 0.05)
    weights = DISCOUNT ** np.arange(n)
    expected = weights @ bonuses + 3.0 * d[0] - 3.0 * 0.98**n * d[-1]
    assert weights @ rewards == pytest.approx(expected, abs=1e-12)
    assert sum(rewards) == pytest.approx(bonuses.sum() + 3.0 * d[0] - 3.0 * d[-1] + 0.06 * d[1:].sum(), abs=1e-12)


def test_at_truncation_the_potential_does_not_vanish():
    """Two ways of acting with the same bonuses, none, differ in return by 0.66 times how far from the target they end."""

    def episode(action):
        env = gymnasium.make("Flag-v0", tolerance=1e-9)
        env.reset(seed=0)
        steps = [env.step(np.full(3, action, np.float32)) for _ in range(75)]
        distances = np.array([info["distance"] for *_, info in steps])
        assert (distances > 1e-9).all()
        return DISCOUNT ** np.arange(75) @ [reward for _, reward, *_ in steps], distances[-1]

    (one, near), (other, far) = episode(0.0), episode(1.0)
    assert near != far
    assert one - other == pytest.approx(-3.0 * 0.98**75 * (near - far), abs=1e-12)
