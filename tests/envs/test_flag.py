"""Arguments of the environments and their errors; worker processes; importing."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same
from stable_baselines3.common.vec_env import SubprocVecEnv

import flag_env  # noqa: F401
from flag_env.physics import effects, presets


@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"control": "sail"}, ValueError, r"control must be one of 'wind', 'mast', 'both', .* got 'sail'"),
        ({"level": "hurricane"}, ValueError, r"level must be one of 'calm', 'breeze', .* got 'hurricane'"),
        ({"split": "exam"}, ValueError, r"split must be one of .*, got 'exam'"),
        ({"reward": "gold"}, ValueError, r"reward must be one of .*, got 'gold'"),
        ({"tolerance": 0.0}, ValueError, r"tolerance must be finite and > 0, got 0.0"),
        ({"tolerance": "5 %"}, TypeError, r"tolerance must be a number, got '5 %'"),
        ({"scene": "curtain"}, ValueError, r"scene must be one of 'flag'.*, got 'curtain'"),
        ({"scene": presets.flag(5, 8, length=120.0)}, ValueError, r"scene must fit into 100 m, got .* 120.004 m"),
        ({"scene": presets.flag(5, 8, length=80.0, height=80.0)}, ValueError, r"scene must fit into 100 m, got .* 113.137 m"),
        ({"scene": presets.sheet(5, 8)}, ValueError, r"scene must have three dimensions.* got dimensions=2"),
        ({"scene": presets.flag(5, 8).without(effects.CosineWind)}, ValueError, r"scene must hold a wind.* its effects: Gravity"),
        ({"scene": presets.flag(5, 8, pinned="none"), "control": "mast"}, ValueError, r"scene must pin particles .*'none'"),
        ({"width": 3}, ValueError, r"width must be .* from 64 to 8192, got 3"),
    ],
)
def test_bad_arguments_are_named(kwargs, error, message):
    with pytest.raises(error, match=message):
        gymnasium.make("Flag-v0", **kwargs)


@pytest.mark.parametrize(
    "options",
    [{"goal": 1}, {"target": -1}, {"target": 10**6}, {"target": "first"}, {"target": True}, 5, ["target"], "target", {3: 4}],
)
def test_bad_reset_options_are_named(options):
    env = gymnasium.make("Flag-v0").unwrapped
    env.reset(seed=3)
    generator = env.np_random.bit_generator.state
    with pytest.raises((ValueError, TypeError), match=r"options"):
        env.reset(seed=4, options=options)
    assert env.np_random.bit_generator.state == generator
    assert env.np_random_seed == 3


def test_step_before_reset_is_refused():
    with pytest.raises(gymnasium.error.ResetNeeded):
        gymnasium.make("Flag-v0").unwrapped.step(np.zeros(3))


@pytest.mark.parametrize("scene", ["two_layer_flag", presets.flag(5, 8), presets.flag(6, 9, dtype="float32")])
@pytest.mark.parametrize("control", ["wind", "mast"])
def test_other_scenes_take_targets_where_the_witness_leads(scene, control):
    env = gymnasium.make("Flag-v0", scene=scene, control=control, split="validation")
    env.reset(seed=0, options={"target": 3})
    for action in env.unwrapped.library.actions(3):
        *_, info = env.step(action)
    assert info["distance"] == 0.0


def test_hidden_wind_is_felt_only_through_the_flag():
    """Two targets alike in pose would look alike: the first observation holds nothing but pose, target and actuators."""
    env = gymnasium.make("Flag-v0", level="breeze").unwrapped
    first = [env.reset(options={"target": target})[0] for target in (0, 1)]
    still = np.r_[0:90, 180 - 45 : 180]
    goal_free = np.r_[0:90, 180:184]
    assert np.array_equal(first[0][goal_free], first[1][goal_free])
    assert not np.array_equal(first[0][still], first[1][still])


def _make():
    return gymnasium.make("Flag-v0", split="validation")


@pytest.mark.linux
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_worker_processes_after_kernels_ran_here(method):
    """Threads of the parent do not exist in a forked child; its results are those of this process."""
    single = _make()
    expected = single.reset(seed=3)[0], single.step(np.ones(3, np.float32))[0]
    workers = gymnasium.vector.AsyncVectorEnv([_make] * 2, context=method)
    try:
        observation, _ = workers.reset(seed=[3, 3])
        after = workers.step(np.ones((2, 3), np.float32))[0]
    finally:
        workers.close()
    assert same((observation[1], after[1]), expected)


@pytest.mark.linux
@pytest.mark.parametrize("method", ["fork", "forkserver"])
def test_sb3_worker_processes_after_kernels_ran_here(method):
    single = _make()
    expected = single.reset(seed=4)[0], single.step(np.ones(3, np.float32))[0]
    workers = SubprocVecEnv([_make] * 2, start_method=method)
    try:
        workers.seed(3)
        observation = workers.reset()
        after = workers.step(np.ones((2, 3), np.float32))[0]
        assert same((observation[1], after[1]), expected)
    finally:
        workers.close()


def test_importing_registers_the_ids_and_loads_nothing_heavy():
    code = (
        "import sys, gymnasium; before = set(sys.modules); import flag_env, importlib; importlib.reload(flag_env);"
        "assert 'Flag-v0' in gymnasium.registry;"
        "heavy = {'numba', 'scipy', 'matplotlib', 'torch', 'stable_baselines3'} & (set(sys.modules) - before);"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_stepping_loads_no_drawing_and_no_learning_library():
    code = (
        "import sys, gymnasium; env = gymnasium.make('flag_env:Flag-v0'); env.reset(seed=0); env.step(env.action_space.sample());"
        "assert not {'matplotlib', 'torch', 'stable_baselines3'} & set(sys.modules);"
        "env = gymnasium.make('Flag-v0', render_mode='rgb_array'); env.reset(seed=0); env.render();"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
