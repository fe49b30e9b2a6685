"""Environments under fire: any actions, any order of calls, many episodes; no bad number, no surprise, no growing memory."""

import itertools

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

import flag_env  # noqa: F401
from flag_env.tasks import rungs

IDS = ("Flag-v0", "FlagGoal-v0", "FlagGoalDense-v0")
RELEASED = (("wind", "calm"), ("wind", "breeze"), ("mast", "calm"), ("mast", "breeze"))
CASES = [(env_id, *task) for env_id, task in itertools.product(IDS, RELEASED)]
CASES += [("Flag-v0", *task) for task in rungs() if task not in RELEASED]


def random_actions(rng, observation, shape):
    return rng.uniform(-1, 1, shape)


def bang_bang(rng, observation, shape):
    return rng.choice([-1.0, 1.0], shape)


def adversarial(rng, observation, shape):
    """Pushes where the flag is moving already, so that it swings ever higher; beyond the box, which clips it."""
    flat = observation["observation"] if isinstance(observation, dict) else observation
    mean = flat[:, 45:90] if flat.shape[1] >= 90 else flat[:, :9].reshape(len(flat), -1, 3).mean(axis=1)
    return 1e6 * np.sign(np.resize(mean.T, shape[::-1]).T + 1e-12)


@pytest.mark.parametrize("act", [random_actions, bang_bang, adversarial])
@pytest.mark.parametrize("case", CASES, ids="-".join)
@pytest.mark.parametrize("steps", [320, pytest.param(28_000, marks=pytest.mark.slow)])  # 36 x 28 000: a million
def test_no_action_brings_a_bad_number(case, act, steps, record_property):
    env_id, control, level = case
    flags = 4 if steps < 1000 else 64
    env = gymnasium.make_vec(
        env_id, flags, vectorization_mode="vector_entry_point", control=control, level=level, max_episode_steps=75
    )
    rng, bad, outside, ended = np.random.default_rng(0), 0, 0, 0
    observation, _ = env.reset(seed=0)
    for _ in range(-(-steps // flags)):
        observation, reward, terminated, _, _ = env.step(act(rng, observation, env.action_space.shape))
        parts = observation.values() if isinstance(observation, dict) else [observation]
        bad += sum(int((~np.isfinite(part)).sum()) for part in parts) + int((~np.isfinite(reward)).sum())
        outside += not env.observation_space.contains(observation)
        ended += int(terminated.sum())
    record_property("steps", flags * -(-steps // flags))
    record_property("non-finite numbers, observations outside, divergences", [bad, outside, ended])
    assert (bad, outside, ended) == (0, 0, 0)


class AnyOrder(RuleBasedStateMachine):
    """An environment keeps its promises whatever is called when; set back to a state, it repeats itself."""

    @initialize(env_id=st.sampled_from(IDS), task=st.sampled_from(RELEASED))
    def make(self, env_id, task):
        control, level = task
        self.env = gymnasium.make(
            env_id, control=control, level=level, render_mode="rgb_array", width=64, height=64, disable_env_checker=True
        ).unwrapped
        self.begun, self.kept = False, None

    @rule(seed=st.integers(0, 2**31), number=st.one_of(st.none(), st.integers(0, 767)))
    def reset(self, seed, number):
        observation, info = self.env.reset(seed=seed, options=None if number is None else {"target": number})
        assert self.env.observation_space.contains(observation)
        assert number in (None, info["target"])
        self.begun = True

    @rule(value=st.floats(-1e9, 1e9), repeat=st.integers(1, 4))
    def step(self, value, repeat):
        action = np.full(self.env.action_space.shape, value)
        if not self.begun:
            with pytest.raises(gymnasium.error.ResetNeeded):
                self.env.step(action)
            return
        for _ in range(repeat):
            observation, reward, terminated, _, _ = self.env.step(action)
            assert self.env.observation_space.contains(observation)
            assert np.isfinite(reward)
            assert not terminated

    @rule(bad=st.sampled_from([np.nan, np.inf, -np.inf]))
    def step_badly(self, bad):
        before = self.env.simulator.positions
        with pytest.raises(ValueError, match="action must be finite"):
            self.env.step(np.full(self.env.action_space.shape, bad))
        assert np.array_equal(before, self.env.simulator.positions)

    @rule()
    def render(self):
        frame = self.env.render()
        assert frame.shape == (64, 64, 3)
        assert frame.dtype == np.uint8

    @rule()
    def close(self):
        self.env.close()

    @rule()
    def get_state(self):
        self.kept = self.env.simulator.get_state()

    @precondition(lambda self: self.kept is not None)
    @rule()
    def set_state(self):
        """At any time: before a reset, in another episode, after a close."""
        simulator = self.env.simulator
        simulator.set_state(self.kept)
        assert simulator.time == self.kept.time
        assert np.array_equal(simulator.get_state().positions, self.kept.positions)

    @rule(steps=st.integers(0, 60))
    def go_back(self, steps):
        simulator = self.env.simulator
        state = simulator.get_state()
        ends = []
        for _ in range(2):
            simulator.set_state(state)
            simulator.step(steps)
            ends.append((simulator.positions, simulator.velocities))
        assert same(*ends)


AnyOrder.TestCase.settings = settings(
    max_examples=60, stateful_step_count=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
TestAnyOrder = AnyOrder.TestCase


def resident():
    import resource

    with open("/proc/self/statm") as file:  # noqa: PTH123
        return int(file.read().split()[1]) * resource.getpagesize() / 2**20


@pytest.mark.linux
@pytest.mark.parametrize(
    ("episodes", "frames"),
    [(400, 40), pytest.param(100_000, 0, marks=pytest.mark.slow), pytest.param(0, 10_000, marks=pytest.mark.slow)],
)
def test_memory_stays_flat(episodes, frames, record_property):
    """Between the first tenth and the end."""
    env = gymnasium.make("Flag-v0", render_mode="rgb_array", width=160, height=120)
    action = np.zeros(env.action_space.shape, np.float32)

    def work(share):
        for _ in range(episodes // share):
            env.reset()
            env.step(action)
        for _ in range(frames // share):
            env.render()

    env.reset(seed=0)
    work(10)
    before = resident()
    work(1)
    grown = resident() - before
    record_property("growth [MiB]", round(grown, 2))
    assert grown < 4.0
