"""What one waits for, timed by `pytest tests/benchmarks -n 0 --benchmark-enable`; else each runs once, untimed.

For following a figure from commit to commit (`--benchmark-autosave`, `--benchmark-compare`); ratios to baselines are the matter
of `flag-env speed`.
"""

import gymnasium
import numpy as np
import pytest

import flag_env  # noqa: F401
from flag_env.physics import Simulator, integrators, presets

ACTION = np.array([0.5, -0.5, 0.2], np.float32)


@pytest.mark.parametrize(("rows", "cols"), [(10, 16), (20, 32), (80, 128)])
def test_hundred_steps_of_a_flag(benchmark, rows, cols):
    simulator = Simulator(presets.flag(rows, cols, integrator=integrators.LFAB(), dtype="float32"), threads=1)
    benchmark(simulator.step, 100)
    assert simulator.time > 0
    assert np.isfinite(simulator.positions).all()


def test_environment_step(benchmark):
    env = gymnasium.make("Flag-v0").unwrapped
    env.reset(seed=0)
    observation, *_ = benchmark(env.step, ACTION)
    assert observation in env.observation_space


def test_environment_reset(benchmark):
    env = gymnasium.make("Flag-v0").unwrapped
    observation, _ = benchmark(env.reset)
    assert observation in env.observation_space


@pytest.mark.parametrize("threads", [1, 2])
def test_vector_environment_step(benchmark, threads):
    envs = gymnasium.make_vec("Flag-v0", 64, vectorization_mode="vector_entry_point", threads=threads)
    envs.reset(seed=0)
    observation, *_ = benchmark(envs.step, np.tile(ACTION, (64, 1)))
    assert observation in envs.observation_space


def test_frame(benchmark):
    env = gymnasium.make("Flag-v0", render_mode="rgb_array").unwrapped
    env.reset(seed=0)

    def move():
        env.step(ACTION)

    frame = benchmark.pedantic(env.render, setup=move, rounds=40)
    assert frame.shape == (480, 480, 3)
