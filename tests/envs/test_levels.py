"""Every rung of the ladder: its witnesses reach its targets, idle hands do not, and what is seen and paid is as told."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same

import flag_env  # noqa: F401
from flag_env.envs.frames import Frames
from flag_env.tasks import LEVELS, load_targets, rungs

NEW = [(control, level) for control, level in rungs() if LEVELS[level].witness is not None]
COPIES = 6


def many(control, level, split="validation", num_envs=COPIES, **keywords):
    return gymnasium.make_vec(
        "Flag-v0", num_envs, vectorization_mode="vector_entry_point", control=control, level=level, split=split, **keywords
    ).unwrapped


def started(envs, targets):
    for copy, target in enumerate(targets):
        observation, info = envs.reset(options={"reset_mask": np.arange(envs.num_envs) == copy, "target": int(target)})
    return observation, info


def end_of(envs, actions):
    """Last info of an episode, and the distances of its steps."""
    distances = []
    for row in actions:
        info = envs.step(row)[4]
        distances.append(info["distance"])
    return info, np.array(distances)


@pytest.mark.parametrize("split", ["validation", "shift"])
@pytest.mark.parametrize(("control", "level"), NEW)
def test_witnesses_reach_their_targets_and_idle_hands_do_not(control, level, split):
    envs, targets = many(control, level, split), np.arange(0, 128, 128 // COPIES)[:COPIES]
    started(envs, targets)
    actions = np.stack([envs.witness(copy) for copy in range(COPIES)], axis=1)
    info, distances = end_of(envs, actions)
    assert info["is_success"].all()
    assert distances[-LEVELS[level].goal.steps :].max() < 1e-3  # 0 to the bit where the same processor found the targets
    started(envs, targets)
    info, distances = end_of(envs, np.zeros_like(actions))
    assert not info["is_success"].any()
    hidden = np.abs(load_targets(control, level, split).wind)
    inside = hidden <= np.array(LEVELS[level].hidden_wind, np.float32) + 1e-6
    assert (inside.all(axis=1) == (split == "validation")).all()


@pytest.mark.parametrize(("control", "level"), [("wind", "wave"), ("wind", "storm"), ("mast", "whip"), ("wind", "sensors")])
def test_single_equals_vector_to_the_bit(control, level):
    """Whatever the other flags do, turbulence and moving targets included."""
    envs, rng = many(control, level, num_envs=3), np.random.default_rng(1)
    single = gymnasium.make("Flag-v0", control=control, level=level, split="validation")
    first = started(envs, [7, 3, 9])[0][1]
    assert same(single.reset(options={"target": 3})[0], first)
    for _ in range(75):
        actions = rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        observation, reward, *_ = envs.step(actions)
        mine = single.step(actions[1])
        assert mine[0].tobytes() == observation[1].tobytes()
        assert type(mine[1]) is float
        assert mine[1] == reward[1]
        assert mine[1] == sum(value for name, value in mine[4].items() if name.startswith("reward_"))


def test_an_episode_of_a_storm_follows_its_target_not_the_seed():
    env = gymnasium.make("Flag-v0", level="storm", split="validation").unwrapped
    last = []
    for seed, target in ((1, 5), (2, 5), (1, 6)):
        env.reset(seed=seed, options={"target": target})
        for _ in range(5):
            env.step(np.zeros(3, np.float32))
        last.append(env.simulator.positions)
    np.testing.assert_array_equal(last[0], last[1])
    assert not np.array_equal(last[0], last[2])


def test_a_wave_shows_where_its_target_will_be():
    """The target k steps ahead is where the flag is k steps later under the witness."""
    env = gymnasium.make("Flag-v0", level="wave", split="validation").unwrapped
    observation = env.reset(options={"target": 4})[0]
    seen, nodes = [observation], []
    at, batch = env._batch.layout, env._batch
    for action in env.witness():
        seen.append(env.step(action)[0])
        nodes.append(env.simulator.positions.reshape(-1, 3)[batch.nodes].ravel())
    for step, observation in enumerate(seen):
        now = observation[at.positions]
        for look, ahead in enumerate((1, 3, 6, 12)):
            later = nodes[min(step + ahead - 1, 74)]
            shown = observation[at.ahead][45 * look : 45 * (look + 1)]
            np.testing.assert_allclose(shown, (later - now) / (0.1 * batch.diagonal), atol=1e-5)


def test_sensors_are_three_markers_without_velocities():
    env = gymnasium.make("Flag-v0", level="sensors").unwrapped
    assert env.observation_space.shape == (3 * 9 + 3 + 1,)
    seen = env.reset(seed=0)[0]
    markers = [(0, 15), (9, 15), (5, 8)]
    np.testing.assert_array_equal(
        seen[:9].reshape(3, 3), [env.simulator.positions[0, 0][marker].astype("f4") for marker in markers]
    )
    np.testing.assert_allclose(seen[9:18].reshape(3, 3), [env.target[0][marker] for marker in markers], atol=1e-6)


def test_a_mast_level_shows_where_the_mast_is_to_be():
    env = gymnasium.make("Flag-v0", control="mast", level="swing", split="validation").unwrapped
    env.reset(options={"target": 2})
    for action in env.witness():
        seen = env.step(action)[0]
    at = env._batch.layout
    np.testing.assert_allclose(seen[at.mast_target], seen[at.actuators][:5], atol=1e-4)
    np.testing.assert_allclose(seen[at.mast_error], 0.0, atol=1e-4)


def test_snap_pays_at_the_end_and_its_approach_telescopes():
    env = gymnasium.make("Flag-v0", level="snap", split="validation")
    d, rng = [env.reset(options={"target": 0})[1]["distance"]], np.random.default_rng(0)
    rewards, infos = [], []
    for _ in range(75):
        _, reward, _, _, info = env.step(rng.uniform(-1, 1, 3).astype(np.float32))
        rewards.append(reward)
        infos.append(info)
        d.append(info["distance"])
    weights = 0.98 ** np.arange(75)
    assert weights @ [info["reward_approach"] for info in infos] == pytest.approx(3 * d[0] - 3 * 0.98**75 * d[-1], abs=1e-12)
    assert all(info["reward_closeness"] == info["reward_reached"] == 0.0 for info in infos[:-1])
    assert infos[-1]["reward_closeness"] == pytest.approx(2 * np.exp(-d[-1] / 0.05), rel=1e-12)
    env.reset(options={"target": 0})
    for action in env.unwrapped.witness():
        info = env.step(action)[4]
    assert (info["reward_reached"], info["is_success"]) == (1.0, True)


def test_tracking_pays_as_told():
    env = gymnasium.make("Flag-v0", level="wave", split="validation")
    env.reset(options={"target": 1})
    for action in np.concatenate([env.unwrapped.witness()[:30], np.ones((20, 3), np.float32)]):
        _, reward, _, _, info = env.step(action)
        d = info["distance"]
        assert reward == pytest.approx(0.1 * (d < 0.05) + 0.1 * np.exp(-((d / 0.1) ** 2)) - 0.3 * d, abs=1e-14)
    assert d > 0.05


@pytest.mark.parametrize(
    ("control", "level"), [("wind", "storm"), ("both", "wave"), ("mast", "whip"), ("wind+frequency", "wave")]
)
def test_a_state_goes_from_a_vector_to_a_single_environment_and_back(control, level):
    envs, rng = many(control, level, num_envs=3), np.random.default_rng(2)
    single = gymnasium.make("Flag-v0", control=control, level=level, split="validation").unwrapped
    started(envs, [1, 2, 3])
    for _ in range(20):
        envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32))
    state = envs.get_state(1)
    single.set_state(state)
    rest = rng.uniform(-1, 1, (10, envs.action_space.shape[1])).astype(np.float32)
    expected = [single.step(action) for action in rest]
    np.testing.assert_array_equal(single.target, envs.target[1] if not LEVELS[level].goal.moving else single.target)
    envs.set_state(state, copies=[0, 2])
    for action, mine in zip(rest, expected, strict=True):
        observation, reward, *_ = envs.step(np.tile(action, (3, 1)))
        for copy in range(3):
            assert observation[copy].tobytes() == mine[0].tobytes()
            assert reward[copy] == mine[1]
    back = single.get_state()
    single.step(rest[0])
    single.set_state(back)
    with pytest.raises(ValueError, match="state must come from an environment of the same"):
        gymnasium.make("Flag-v0").unwrapped.set_state(back)
    with pytest.raises(TypeError, match="state must come from get_state"):
        single.set_state(3)


def test_what_a_level_does_not_have_is_refused_by_name():
    make = gymnasium.make
    with pytest.raises(ValueError, match="level must be one of 'calm', 'breeze', 'swing', 'whip', got 'wave'"):
        make("Flag-v0", control="mast", level="wave")
    with pytest.raises(ValueError, match="split must be one of 'train', 'validation', 'test', got 'shift'"):
        make("Flag-v0", split="shift")
    with pytest.raises(ValueError, match=r"level must have a pose for its goal .* got 'wave'"):
        make("FlagGoal-v0", level="wave")
    with pytest.raises(ValueError, match="control must move the mast for view='mast'"):
        make("Flag-v0", view="mast")
    with pytest.raises(ValueError, match="view must be one of"):
        make("Flag-v0", view="eyes")


def test_views_can_be_chosen_and_goals_are_poses():
    full = gymnasium.make("Flag-v0", level="sensors", view="nodes")
    assert full.observation_space == gymnasium.make("Flag-v0").observation_space
    for control, level in (("wind", "snap"), ("mast", "whip"), ("wind", "sensors")):
        env = gymnasium.make("FlagGoalDense-v0", control=control, level=level, split="validation")
        env.reset(options={"target": 1})
        for action in env.unwrapped.witness():
            observation, reward, *_ = env.step(action)
        np.testing.assert_allclose(observation["achieved_goal"], observation["desired_goal"], atol=0.02)
        assert reward == env.unwrapped.compute_reward(observation["achieved_goal"], observation["desired_goal"], {})


def test_targets_that_were_replayed_are_kept_on_disk_and_damage_is_mended(tmp_path, monkeypatch):
    monkeypatch.setattr("flag_env.envs.frames.cache_root", lambda: tmp_path)
    config = gymnasium.make("Flag-v0", level="snap", split="shift").unwrapped._batch.config
    calls = []

    def replayed(config, library, indices, steps):
        calls.append(len(indices))
        return np.full((steps, len(indices), 1, 10, 16, 3), 0.5)

    first = np.array(Frames(config, replayed).all())
    assert sum(calls) == len(first) == 128
    (path,) = (tmp_path / "targets").iterdir()
    np.testing.assert_array_equal(Frames(config, replayed).all(), first)
    assert sum(calls) == 128
    half = path.read_bytes()[:1000]
    path.unlink()  # what maps the old file keeps it
    path.write_bytes(half)
    np.testing.assert_array_equal(Frames(config, replayed).all(), first)
    assert sum(calls) == 256
