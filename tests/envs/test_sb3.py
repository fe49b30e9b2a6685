"""`FlagSB3VecEnv` equals SB3's own `DummyVecEnv`, and SB3's algorithms learn on it."""

import inspect

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

import flag_env  # noqa: F401
from flag_env.envs.config import FlagConfig
from flag_env.envs.sb3 import FlagSB3VecEnv
from flag_env.envs.vector import FlagVectorEnv


@pytest.mark.parametrize("env_id", ["Flag-v0", "FlagGoal-v0", "FlagGoalDense-v0"])
def test_equals_dummy_vec_env(env_id):
    ours = FlagSB3VecEnv(3, env_id, max_episode_steps=6)
    theirs = DummyVecEnv([lambda: gymnasium.make(env_id, max_episode_steps=6)] * 3)
    ours.seed(4)
    theirs.seed(4)
    assert same(ours.reset(), dict(theirs.reset()) if env_id != "Flag-v0" else theirs.reset())
    rng = np.random.default_rng(0)
    for _ in range(14):
        action = rng.uniform(-1, 1, (3, 3)).astype(np.float32)
        mine, other = ours.step(action), list(theirs.step(action))
        if env_id != "Flag-v0":
            other[0] = dict(other[0])
        for info in other[3]:
            info.pop("episode", None)
        for part, (a, b) in enumerate(zip(mine, other, strict=True)):
            assert same(a, b), (part, a, b)
        assert same(ours.reset_infos, theirs.reset_infos)


def test_equals_dummy_vec_env_where_flags_end_apart():
    ours = FlagSB3VecEnv(3, max_episode_steps=4)
    theirs = DummyVecEnv([lambda: gymnasium.make("Flag-v0", max_episode_steps=4)] * 3)
    for env in (ours, theirs):
        env.seed(4)
        env.reset()
    action = np.full((3, 3), 0.5, np.float32)
    ours.step(action)
    theirs.step(action)
    ours.env.reset(options={"reset_mask": np.array([False, True, False])})  # one step behind the others from now on
    theirs.envs[1].reset()
    ended = []
    for _ in range(9):
        mine, other = ours.step(action), theirs.step(action)
        assert all(same(a, b) for a, b in zip(mine, other, strict=True))
        assert same(ours.reset_infos, theirs.reset_infos)
        ended.append(mine[2].tolist())
    assert [True, False, True] in ended
    assert [False, True, False] in ended


def test_takes_every_argument_of_the_vector_environment():
    ours, theirs = (dict(inspect.signature(kind).parameters) for kind in (FlagSB3VecEnv, FlagVectorEnv))
    del ours["env_id"], theirs["autoreset_mode"]
    for parameters in (ours, theirs):
        assert parameters.pop("num_envs").kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
    assert ours == theirs
    env = FlagSB3VecEnv(
        2, "FlagGoal-v0", max_episode_steps=7, threads=1, control="mast", level="calm", split="test", scene="two_layer_flag",
        tolerance=0.04, reward="dense", render_mode="rgb_array", width=80, height=64, accuracy="fast",
    )  # fmt: skip
    assert env.env._batch.config == FlagConfig(
        "mast", "calm", "test", "two_layer_flag", 0.04, "dense", "rgb_array", 80, 64, "fast"
    )
    env.reset()
    assert [frame.shape for frame in env.get_images()] == [(64, 80, 3)] * 2
    steps = [env.step(np.zeros((2, 5), np.float32)) for _ in range(7)]
    assert [step[2].all() for step in steps] == [False] * 6 + [True]
    assert not {0.0, -1.0} & set(steps[0][1].tolist())
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        FlagSB3VecEnv(2, threads=0)


def test_each_flag_takes_options_of_its_own():
    ours, theirs = FlagSB3VecEnv(3), DummyVecEnv([lambda: gymnasium.make("Flag-v0")] * 3)
    for env in (ours, theirs):
        env.seed(4)
        env.set_options([{"target": 7}, {}, {"target": 2}])
    assert same(ours.reset(), theirs.reset())
    assert same(ours.reset_infos, theirs.reset_infos)
    assert [info["target"] for info in ours.reset_infos][::2] == [7, 2]
    assert same(ours.reset(), theirs.reset())  # options are for one reset


def test_attributes_belong_to_one_copy():
    env = FlagSB3VecEnv(3)
    env.set_attr("note", "b", indices=1)
    assert env.get_attr("note", indices=[1]) == ["b"]
    assert env.get_attr("render_mode") == [None] * 3
    with pytest.raises(AttributeError):
        env.get_attr("note", indices=0)
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * 3


def test_attributes_are_those_of_single_environments():
    ours, theirs = FlagSB3VecEnv(3), DummyVecEnv([lambda: gymnasium.make("Flag-v0").unwrapped] * 3)
    for env in (ours, theirs):
        env.seed(4)
        env.reset()
    assert same(ours.get_attr("target"), theirs.get_attr("target"))
    for name in ("library", "observation_space", "action_space", "render_mode"):
        assert ours.get_attr(name) == theirs.get_attr(name)
    assert not np.array_equal(*ours.get_attr("target", indices=[0, 2]))


def test_methods_act_on_the_flags_named_alone():
    """As SB3's own vector of single environments has it: what the other flags do afterwards is as if nothing had been called."""
    ours, untouched = FlagSB3VecEnv(3, render_mode="rgb_array", width=80, height=64), FlagSB3VecEnv(3)
    theirs = DummyVecEnv([lambda: gymnasium.make("Flag-v0", render_mode="rgb_array", width=80, height=64)] * 3)
    action = np.full((3, 3), 0.5, np.float32)
    for env in (ours, theirs, untouched):
        env.seed(4)
        env.reset()
        env.step(action)
    for indices in ([1], 1, [2, 0]):
        frames = ours.env_method("render", indices=indices)
        assert same(frames, theirs.env_method("render", indices=indices))
        assert all(frame.shape == (64, 80, 3) for frame in frames)
    assert same(ours.env_method("witness", indices=[1]), [theirs.envs[1].unwrapped.witness()])
    options = {"target": 5}
    for arguments in ({}, {"seed": 8, "options": options}):
        assert same(ours.env_method("reset", indices=[1], **arguments), theirs.env_method("reset", indices=[1], **arguments))
    mine, other, plain = (env.step(action) for env in (ours, theirs, untouched))
    for part in range(4):
        assert same(mine[part], other[part])
        assert same([mine[part][copy] for copy in (0, 2)], [plain[part][copy] for copy in (0, 2)])
    assert options == {"target": 5}


def test_methods_that_flags_cannot_take_one_by_one_are_refused():
    env = FlagSB3VecEnv(3)
    env.reset()
    for name in ("step", "close", "compute_reward", "fly"):
        with pytest.raises(AttributeError, match=f"method_name must be one of reset, render, .* got '{name}'"):
            env.env_method(name, indices=[1])
    before = env.env.simulator.time
    with pytest.raises(ValueError, match="options"):
        env.env_method("reset", indices=[1], options={"reset_mask": np.ones(3, bool)})
    assert env.env.simulator.time == before


def test_a_refused_reset_of_flags_with_options_of_their_own_changes_nothing():
    env, untouched = FlagSB3VecEnv(3), FlagSB3VecEnv(3)
    for one in (env, untouched):
        one.seed(1)
        one.reset()
    env.set_options([{"target": 1}, {}, {"target": -4}])
    with pytest.raises(ValueError, match="target"):
        env.reset()
    action = np.ones((3, 3), np.float32)
    assert same(env.step(action), untouched.step(action))


def test_seeds_of_single_flags():
    env = FlagSB3VecEnv(3)
    env.seed(4)
    env.reset()
    assert env.get_attr("np_random_seed", indices=[2, 0]) == [6, 4]


@pytest.mark.parametrize(
    ("achieved", "desired", "error", "name"),
    [
        (np.zeros((15, 3)), np.zeros((15, 3)), ValueError, "achieved_goal"),
        (np.zeros((4, 44)), np.zeros((4, 44)), ValueError, "achieved_goal"),
        (np.zeros((4, 45)), np.zeros(45), ValueError, "desired_goal"),
        (np.zeros((4, 45)), np.zeros((5, 45)), ValueError, "desired_goal"),
        (np.zeros(45), np.zeros(15), ValueError, "desired_goal"),
        (0.0, 0.0, ValueError, "achieved_goal"),
        (np.full(45, np.nan), np.zeros(45), ValueError, "achieved_goal"),
        (np.zeros(45), np.full(45, np.inf), ValueError, "desired_goal"),
        (np.zeros(45, complex), np.zeros(45), TypeError, "achieved_goal"),
        (np.zeros(45), np.zeros(45).astype(str), TypeError, "desired_goal"),
        (None, np.zeros(45), TypeError, "achieved_goal"),
    ],
)
def test_goals_that_are_none_are_refused_by_name(achieved, desired, error, name):
    for env in (gymnasium.make("FlagGoal-v0").unwrapped, FlagSB3VecEnv(2, "FlagGoalDense-v0").env):
        with pytest.raises(error, match=name):
            env.compute_reward(achieved, desired, {})


def test_unknown_id_is_named():
    with pytest.raises(ValueError, match=r"env_id must be one of .*, got .Pole-v0."):
        FlagSB3VecEnv(2, "Pole-v0")


def test_rewards_of_goals_alone_equal_those_of_the_steps():
    env = gymnasium.make("FlagGoalDense-v0").unwrapped
    env.reset(seed=0)
    steps = [env.step(env.action_space.sample()) for _ in range(30)]
    achieved, desired = (np.stack([step[0][key] for step in steps]) for key in ("achieved_goal", "desired_goal"))
    rewards = np.array([step[1] for step in steps])
    assert np.array_equal(env.compute_reward(achieved, desired, [{}] * 30), rewards)
    assert type(env.compute_reward(achieved[3], desired[3], {})) is float
    assert env.compute_reward(achieved[3], desired[3], {}) == rewards[3]


def test_algorithms_run():
    PPO("MlpPolicy", VecMonitor(FlagSB3VecEnv(4)), n_steps=16, batch_size=32, n_epochs=1, device="cpu").learn(128)
    agent = SAC(
        "MultiInputPolicy",
        FlagSB3VecEnv(4, "FlagGoal-v0", max_episode_steps=10),
        replay_buffer_class=HerReplayBuffer,
        learning_starts=60,
        device="cpu",
    )
    agent.learn(100)
    assert agent.num_timesteps >= 100
