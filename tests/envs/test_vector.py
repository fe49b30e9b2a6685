"""The native vector environment equals Gymnasium's vector of single environments, to the bit, in every autoreset mode."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import flag_env  # noqa: F401
from flag_env.envs.sb3 import FlagSB3VecEnv
from flag_env.physics import effects, presets

IDS = ("Flag-v0", "FlagGoal-v0", "FlagGoalDense-v0")


def native(env_id="Flag-v0", num_envs=3, **kwargs):
    return gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point", **kwargs)


def singles(env_id="Flag-v0", num_envs=3, autoreset_mode=AutoresetMode.NEXT_STEP, max_episode_steps=75, **kwargs):
    def make():
        return gymnasium.make(env_id, max_episode_steps=max_episode_steps, **kwargs)

    return SyncVectorEnv([make] * num_envs, autoreset_mode=autoreset_mode)


def actions(env, steps, seed=0):
    rng = np.random.default_rng(seed)
    return [rng.uniform(-1, 1, env.action_space.shape).astype(np.float32) for _ in range(steps)]


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("control", ["wind", "mast"])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_equals_single_environments(env_id, control, mode):
    """Episodes of 7 steps, so that resets come often; one flag diverges, so that they fall out of step."""
    ours = native(env_id, control=control, autoreset_mode=mode, max_episode_steps=7)
    theirs = singles(env_id, control=control, autoreset_mode=mode, max_episode_steps=7)
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert ours.metadata["autoreset_mode"] is mode
    assert same(ours.reset(seed=5), theirs.reset(seed=5))
    for number, action in enumerate(actions(ours, 20)):
        if number == 3:
            velocities = ours.unwrapped.simulator.velocities
            velocities[1] = 1e30
            ours.unwrapped.simulator.set_velocities(velocities)
            for copy, env in enumerate(theirs.envs):
                env.unwrapped.simulator.set_velocities(velocities[copy])
        mine, other = ours.step(action), theirs.step(action)
        for part, (a, b) in enumerate(zip(mine, other, strict=True)):
            assert same(a, b), (number, part, a, b)
    assert mine[3].dtype == bool


def test_disabled_autoreset_with_a_mask():
    ours = native(autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=5)
    theirs = singles(autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=5)
    assert same(ours.reset(seed=[1, 2, 3]), theirs.reset(seed=[1, 2, 3]))
    for action in actions(ours, 3):
        assert same(ours.step(action), theirs.step(action))
    mask = np.array([False, True, False])
    assert same(ours.reset(seed=9, options={"reset_mask": mask}), theirs.reset(seed=9, options={"reset_mask": mask.copy()}))
    for action in actions(ours, 2):
        mine, other = ours.step(action), theirs.step(action)
        assert same(mine, other)
    assert mine[3].tolist() == [True, False, True]
    with pytest.raises(ValueError, match=r"reset\(\) must be called for the copies \[0, 2\]"):
        ours.step(actions(ours, 1)[0])


@pytest.mark.parametrize("threads", [1, 2])
def test_bits_do_not_depend_on_threads_or_number(threads):
    many, one = native(num_envs=24, threads=threads), native(num_envs=1)
    many.reset(seed=3)
    one.reset(seed=3 + 17)
    for action in actions(many, 10):
        got, expected = many.step(action), one.step(action[17:18])
        assert np.array_equal(got[0][17], expected[0][0])
        assert got[1][17] == expected[1][0]


def test_step_before_reset_and_bad_masks_are_refused():
    env = native()
    with pytest.raises(ValueError, match=r"reset\(\) must be called for the copies \[0, 1, 2\]"):
        env.step(np.zeros((3, 3)))
    for mask in (np.zeros(3, bool), np.ones(2, bool), [True, False, True], np.ones(3)):
        with pytest.raises(ValueError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="seed must be one number or 3, got 2"):
        env.reset(seed=[1, 2])
    with pytest.raises(ValueError, match="num_envs must be at least 1, got 0"):
        native(num_envs=0)


def test_memory_of_actions_makes_no_difference():
    rows = np.random.default_rng(3).uniform(-1.5, 1.5, (3, 3)).astype(np.float32)
    results = []
    for given in (rows, np.asfortranarray(rows), rows.repeat(2, axis=1)[:, ::2], rows.astype(np.float64), rows.tolist()):
        envs = native()
        envs.reset(seed=0)
        results.append(envs.step(given))
    assert all(same(result, results[0]) for result in results[1:])


def test_non_finite_action_of_one_flag_is_refused_before_anything_changes():
    env, untouched = native(), native()
    env.reset(seed=0)
    untouched.reset(seed=0)
    bad = np.zeros((3, 3))
    bad[1, 1] = np.nan
    with pytest.raises(ValueError, match="action must be finite"):
        env.step(bad)
    assert same(env.step(np.ones((3, 3))), untouched.step(np.ones((3, 3))))


def test_frames_of_all_flags():
    env = native(render_mode="rgb_array", width=80, height=64)
    env.reset(seed=0)
    frames = env.render()
    assert len(frames) == 3
    assert frames[0].shape == (64, 80, 3)
    env.close()


FORK = """
import multiprocessing

import gymnasium
import numpy as np

import flag_env


def step(pipe):
    pipe.send(envs.step(actions)[0])


envs = gymnasium.make_vec("Flag-v0", 64, vectorization_mode="vector_entry_point", threads=2)
actions = np.random.default_rng(0).uniform(-1, 1, (64, 3)).astype(np.float32)
envs.reset(seed=0)
envs.step(actions)
assert envs.simulator.run._threads._pool is not None  # the threads are awake
processes = multiprocessing.get_context("fork")
here, there = processes.Pipe()
child = processes.Process(target=step, args=(there,))
child.start()
assert here.poll(200)
theirs = here.recv()
child.join(200)
print(child.exitcode, np.array_equal(envs.step(actions)[0], theirs))
"""


@pytest.mark.linux
def test_a_forked_child_goes_on_with_threads_of_its_own(run_python):
    """The parent's threads do not exist in the child: it must neither wait for them nor come to other bits."""
    assert run_python(FORK).split() == ["0", "True"]


def test_seeds_can_be_told():
    ours, theirs = native().unwrapped, singles()
    for seed in (7, [4, None, 2**40], np.array([5, 6, 7]), None):
        if isinstance(seed, np.ndarray):
            seed = seed.tolist()
        ours.reset(seed=seed)
        theirs.reset(seed=seed)
        if seed is not None and None not in np.atleast_1d(seed):
            assert ours.np_random_seed == theirs.np_random_seed
    assert ours.np_random_seed == (5, 6, 7)
    assert same([rng.bit_generator.state for rng in ours.np_random], [rng.bit_generator.state for rng in theirs.np_random])
    assert len(set(native().unwrapped.np_random_seed)) == 3
    single = gymnasium.make("Flag-v0")
    single.reset(seed=11)
    assert single.unwrapped.np_random_seed == 11


@pytest.mark.parametrize(
    ("arguments", "error", "name"),
    [
        ({"seed": 3.0}, TypeError, "seed"),
        ({"seed": "345"}, TypeError, "seed"),
        ({"seed": True}, TypeError, "seed"),
        ({"seed": -1}, ValueError, "seed"),
        ({"seed": [7, 8, -1]}, ValueError, "seed"),
        ({"seed": [7, 8, 1.5]}, TypeError, "seed"),
        ({"seed": [7, 8, None, 9]}, ValueError, "seed"),
        ({"seed": np.array([7.0, 8.0, 9.0])}, TypeError, "seed"),
        ({"seed": {7, 8, 9}}, TypeError, "seed"),
        ({"seed": 9, "options": 5}, TypeError, "options"),
        ({"seed": 9, "options": [("target", 3)]}, TypeError, "options"),
        ({"seed": 9, "options": {"target": 1.5}}, ValueError, "target"),
        ({"seed": 9, "options": {"goal": 1}}, ValueError, "goal"),
        ({"seed": 9, "options": {"reset_mask": np.zeros(3, bool)}}, ValueError, "reset_mask"),
    ],
)
def test_a_refused_reset_changes_nothing(arguments, error, name):
    env, untouched = native(), native()
    for one in (env, untouched):
        one.reset(seed=3)
        one.step(np.full((3, 3), 0.5))
    with pytest.raises(error, match=name):
        env.unwrapped.reset(**arguments)
    assert env.unwrapped.np_random_seed == (3, 4, 5)
    for _ in range(2):
        assert same(env.step(np.ones((3, 3))), untouched.step(np.ones((3, 3))))
        assert same(env.reset(), untouched.reset())


@pytest.mark.parametrize("steps", [1, 30, 75, 150])
def test_time_left_follows_the_episodes_length(steps):
    """The last observation says that nothing is left, however long the episode and however it was made."""
    seen = {}
    single = gymnasium.make("Flag-v0", max_episode_steps=steps)
    wrapped = gymnasium.wrappers.TimeLimit(gymnasium.make("Flag-v0", max_episode_steps=200), steps)
    for name, env in (("make", single), ("wrapped", wrapped)):
        seen[name] = [env.reset(seed=0)[0][-1]]
        truncated = False
        while not truncated:
            observation, _, _, truncated, _ = env.step(np.zeros(3, np.float32))
            seen[name].append(observation[-1])
    for mode in ("sync", "vector_entry_point"):
        envs = gymnasium.make_vec("Flag-v0", 2, vectorization_mode=mode, max_episode_steps=steps)
        seen[mode] = [envs.reset(seed=0)[0][1, -1]]
        seen[mode] += [envs.step(np.zeros((2, 3), np.float32))[0][1, -1] for _ in range(steps)]
    sb3 = FlagSB3VecEnv(2, max_episode_steps=steps)
    seen["sb3"] = [sb3.reset()[1, -1]]
    for _ in range(steps):
        observation, _, done, infos = sb3.step(np.zeros((2, 3), np.float32))
        seen["sb3"].append(infos[1]["terminal_observation"][-1] if done[1] else observation[1, -1])
    expected = [np.float32(1.0 - step / steps) for step in range(steps + 1)]
    assert expected[-1] == 0.0
    for name, left in seen.items():
        assert left == expected, name


def test_an_environment_without_a_limit_counts_the_default_steps():
    env = gymnasium.make("Flag-v0", max_episode_steps=-1)
    env.reset(seed=0)
    left = [env.step(np.zeros(3, np.float32))[0][-1] for _ in range(80)]
    np.testing.assert_array_equal(left, np.maximum(1.0 - np.arange(1, 81) / 75, 0).astype(np.float32))


STORM = presets.flag(4, 5).without(effects.CosineWind).adding(effects.Gusts(2.0))


def test_every_copy_and_episode_has_turbulence_of_its_own():
    """It follows the seed of the reset, and the same seed gives the same, single or in a vector, whenever it is reset."""
    ours, theirs = (make(scene=STORM, max_episode_steps=6) for make in (native, singles))
    assert same(ours.reset(seed=5, options={"target": 0}), theirs.reset(seed=5, options={"target": 0}))
    episodes = []
    for number, action in enumerate(np.zeros((20, 3, 3), np.float32)):
        mine, other = ours.step(action), theirs.step(action)
        assert same(mine, other), number
        if number % 7 == 4:
            episodes.append(mine[0][:, :90])
    flat = np.concatenate(episodes)
    assert len(np.unique(flat, axis=0)) == len(flat) == 9
    late = gymnasium.make("Flag-v0", scene=STORM)
    for _ in range(3):
        late.reset()
        late.step(np.ones(3, np.float32))
    late.reset(seed=6, options={"target": 0})
    for _ in range(5):
        observation = late.step(np.zeros(3, np.float32))[0]
    np.testing.assert_array_equal(observation[:90], episodes[0][1])


def test_turbulence_does_not_change_which_targets_are_drawn():
    """One draw an episode in scenes without, as released; the first target of a seed is the same with it."""
    calm, rough = gymnasium.make("Flag-v0"), gymnasium.make("Flag-v0", scene=STORM)
    reference = np.random.default_rng(np.random.PCG64(np.random.SeedSequence(9)))
    assert calm.reset(seed=9)[1]["target"] == rough.reset(seed=9)[1]["target"] == int(reference.integers(768))
    assert calm.reset()[1]["target"] == int(reference.integers(768))


def test_infos_are_masked_arrays():
    env = native(num_envs=2)
    infos = [env.reset(seed=0)[1], env.step(np.zeros((2, 3), np.float32))[4]]
    for info in infos:
        names = {name for name in info if name[0] != "_"}
        assert names == {"distance", "is_success", "diverged", "target", "reward_in_tolerance", "reward_approach"}
        assert set(info) - names == {f"_{name}" for name in names}
        assert all(info[f"_{name}"].dtype == bool and info[name].shape == (2,) for name in names)


def test_factors_of_all_flags_outlive_the_reset_of_one():
    env = native().unwrapped
    env.reset(seed=0)
    env.simulator.set_parameters(stiffness_scale=0.5)
    env.reset(options={"reset_mask": np.array([True, False, False])})
    assert env.simulator.scales == (0.5, 1.0)
    env.reset()
    assert env.simulator.scales == (1.0, 1.0)
