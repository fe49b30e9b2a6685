"""One battery over every environment id and its arguments: Gymnasium's and SB3's checkers, determinism, info, bad input."""

import copy
import itertools
import json
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_checker import data_equivalence as same
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import flag_env  # noqa: F401

IDS = ("Flag-v0", "FlagGoal-v0", "FlagGoalDense-v0")
TASKS = [{"control": control, "level": level} for control in ("wind", "mast") for level in ("calm", "breeze")]
CASES = [("Flag-v0", task) for task in TASKS] + list(zip(IDS[1:], TASKS[1:3], strict=True))
REWARDS = {"Flag-v0": ("shaped", "dense", "sparse"), "FlagGoal-v0": ("sparse", "dense"), "FlagGoalDense-v0": ("dense", "sparse")}


@pytest.fixture(params=CASES, ids=lambda case: "-".join((case[0], *case[1].values())))
def make(request):
    env_id, task = request.param

    def maker(**kwargs):
        return gymnasium.make(env_id, **task, **kwargs)

    maker.env_id = env_id
    return maker


def episode(env, seed, steps=75):
    observation, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    trace = [(observation, 0.0, False, False, info)]
    for _ in range(steps):
        trace.append(env.step(env.action_space.sample()))
    return trace


def test_gymnasium_checker_is_silent(make):
    check_env(make(render_mode="rgb_array").unwrapped)


def test_sb3_checker_is_silent(make):
    sb3_check_env(make().unwrapped)


def test_same_seed_same_bits_other_seed_other_episode(make):
    first, second, other = (episode(make(), seed) for seed in (7, 7, 8))
    assert same(first, second)
    assert not same(first, other)


def test_an_episode_does_not_depend_on_what_came_before(make):
    fresh, used = make(), make()
    episode(used, 3, steps=31)
    used.unwrapped.simulator.set_wind(frequency=(9.0, 9.0, 9.0))
    assert same(episode(fresh, 11), episode(used, 11))


def test_episode_is_truncated_after_75_steps_and_not_terminated(make):
    trace = episode(make(), 0)
    assert [entry[3] for entry in trace] == [False] * 75 + [True]
    assert not any(entry[2] for entry in trace)


def test_observations_stay_in_their_space_and_are_fresh(make):
    env = make()
    trace = episode(env, 1)
    assert all(env.observation_space.contains(entry[0]) for entry in trace)
    parts = [list(entry[0].values()) if isinstance(entry[0], dict) else [entry[0]] for entry in trace]
    assert not any(np.shares_memory(x, y) for a, b in itertools.pairwise(parts) for x in a for y in b)


def test_reward_terms_sum_to_the_reward(make):
    for reward in REWARDS[make.env_id]:
        for _, value, _, _, info in episode(make(reward=reward), 2, steps=20)[1:]:
            assert type(value) is float
            assert value == sum(term for name, term in info.items() if name.startswith("reward_"))


def test_infos_are_flat_and_alike_from_the_reset_on(make):
    for reward, terms in (("shaped", {"in_tolerance", "approach"}), ("dense", {"distance"}), ("sparse", {"miss"})):
        if reward not in REWARDS[make.env_id]:
            continue
        first, *rest = (entry[4] for entry in episode(make(reward=reward), 2, steps=3))
        kinds = {name: type(value) for name, value in first.items()}
        rewards = {f"reward_{term}": float for term in terms}
        assert kinds == {"distance": float, "is_success": bool, "diverged": bool, "target": int, **rewards}
        assert not any(first[name] for name in rewards)
        for info in rest:
            assert {name: type(value) for name, value in info.items()} == kinds
            assert list(info) == list(first)


@pytest.mark.parametrize("split", ["train", "validation", "test"])
def test_the_witness_reaches_the_present_target(make, split):
    env = make(split=split)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.unwrapped.witness()
    for options in ({"target": 1}, None):
        env.reset(seed=12, options=options)
        actions = env.unwrapped.witness()
        assert actions.shape == (75, *env.action_space.shape)
        assert actions.dtype == np.float32
        for action in actions:
            *_, truncated, info = env.step(action)
        assert truncated
        assert info["is_success"]


def test_shaped_reward_telescopes():
    """Discounted by 0.98, the potential-based terms leave only the potential's ends."""
    trace = episode(gymnasium.make("Flag-v0"), 4)
    approach = [entry[4]["reward_approach"] for entry in trace[1:]]
    total = sum(0.98**step * value for step, value in enumerate(approach))
    ends = 3 * (trace[0][4]["distance"] - 0.98**75 * trace[-1][4]["distance"])
    assert total == pytest.approx(ends, rel=1e-12)


def test_distance_is_rms_over_particles_per_diagonal(make):
    env = make()
    info = episode(env, 5)[-1][4]
    gap = np.linalg.norm(env.unwrapped.simulator.positions[0] - env.unwrapped.target, axis=-1)
    assert info["distance"] == pytest.approx(np.sqrt(np.mean(gap**2)) / np.hypot(1.5, 1.0), rel=1e-12)


@pytest.mark.parametrize("split", ["train", "validation", "test"])
def test_witness_reaches_its_target_and_repeats_bit_for_bit(make, split):
    env = make(split=split)
    library = env.unwrapped.library
    for target in (0, len(library) // 2, len(library) - 1):
        ends = []
        for _ in range(2):
            env.reset(seed=0, options={"target": target})
            for action in library.actions(target):
                *_, info = env.step(action)
            ends.append(env.unwrapped.simulator.positions)
            assert info["is_success"]
            assert info["target"] == target
        assert np.array_equal(*ends)
        assert np.abs(ends[0] - env.unwrapped.target).max() <= 2.0**-13 + 1e-12


def test_success_needs_ten_steps_in_a_row(make):
    env = make()
    target = 0
    env.reset(seed=0, options={"target": target})
    inside = 0
    for action in env.unwrapped.library.actions(target):
        *_, info = env.step(action)
        inside = inside + 1 if info["distance"] < 0.05 else 0
        assert info["is_success"] == (inside >= 10)
    assert inside >= 10


def test_actions_outside_the_box_are_clipped(make):
    env, clipped = make().unwrapped, make().unwrapped
    env.reset(seed=0)
    clipped.reset(seed=0)
    action = np.linspace(-3.0, 3.0, env.action_space.shape[0])
    assert same(env.step(action), clipped.step(np.clip(action, -1, 1)))


def test_type_and_memory_of_an_action_make_no_difference(make):
    size = make().action_space.shape[0]
    row = np.linspace(-1.5, 1.5, size).astype(np.float32)
    strided = np.repeat(row, 2)[::2]
    assert not strided.flags.c_contiguous
    locked = row.copy()
    locked.setflags(write=False)
    swapped = row.astype(row.dtype.newbyteorder())
    results = []
    for action in (row, strided, locked, swapped, row.astype(np.float64), [float(entry) for entry in row]):
        env = make().unwrapped
        env.reset(seed=0)
        results.append(env.step(action))
    assert all(same(result, results[0]) for result in results[1:])
    np.testing.assert_array_equal(row, np.linspace(-1.5, 1.5, size).astype(np.float32))  # nor are they written to


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_non_finite_action_is_refused_before_anything_changes(make, bad):
    env, untouched = make().unwrapped, make().unwrapped
    env.reset(seed=0)
    untouched.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    action[-1] = bad
    with pytest.raises(ValueError, match=r"action must be finite"):
        env.step(action)
    assert same(env.step(np.zeros_like(action)), untouched.step(np.zeros_like(action)))


def test_action_of_the_wrong_shape_is_refused(make):
    env = make().unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action must have the shape \(\d,\), got \(7,\)"):
        env.step(np.zeros(7))


def test_a_diverged_flag_ends_the_episode_with_finite_numbers(make):
    env = make()
    env.reset(seed=0)
    simulator = env.unwrapped.simulator
    simulator.set_velocities(np.full(simulator.velocities.shape, 1e30))
    observation, reward, terminated, _, info = env.step(np.zeros(env.action_space.shape, np.float32))
    assert terminated is True
    assert info["diverged"] is True
    assert env.observation_space.contains(observation)
    assert np.isfinite(reward)
    observation, info = env.reset(seed=0)
    assert same((observation, info), make().reset(seed=0))


@pytest.mark.parametrize("twin_of", [lambda env: pickle.loads(pickle.dumps(env)), copy.deepcopy], ids=["pickled", "copied"])
def test_a_twin_made_in_mid_episode_goes_on_alike(make, twin_of):
    env = make().unwrapped
    episode(env, 6, steps=5)
    twin = twin_of(env)
    action = np.full(env.action_space.shape, 0.3)
    own = env.step(action)
    assert same(own, twin.step(action))
    assert same(env.step(action), twin.step(action))  # and each in memory of its own


def test_frame(make):
    env = make(render_mode="rgb_array", width=320, height=240)
    env.reset(seed=0)
    frame = env.render()
    assert frame.shape == (240, 320, 3)
    assert frame.dtype == np.uint8
    env.step(env.action_space.sample())
    assert (env.render() != frame).any()
    env.close()
    env.close()


def test_spec_is_json(make):
    spec = make(tolerance=0.03, reward="dense").spec
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()))
    assert json.loads(spec.to_json())["kwargs"]["tolerance"] == 0.03
    assert same(episode(again, 1, steps=2), episode(gymnasium.make(spec), 1, steps=2))
