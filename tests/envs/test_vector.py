"""The native vector environment equals Gymnasium's vector of single environments, to the bit, in every autoreset mode."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import flag_env  # noqa: F401

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
    env = native(render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    frames = env.render()
    assert len(frames) == 3
    assert frames[0].shape == (48, 64, 3)
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
assert envs.simulator._run._threads._pool is not None  # the threads are awake
processes = multiprocessing.get_context("fork")
here, there = processes.Pipe()
child = processes.Process(target=step, args=(there,))
child.start()
assert here.poll(200)
theirs = here.recv()
child.join(200)
print(child.exitcode, np.array_equal(envs.step(actions)[0], theirs))
"""


def test_a_forked_child_goes_on_with_threads_of_its_own(run_python):
    """The parent's threads do not exist in the child: it must neither wait for them nor come to other bits."""
    assert run_python(FORK).split() == ["0", "True"]
