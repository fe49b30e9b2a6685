"""The environments' accuracy argument: the default scene to the bit, coarser and finer ones with the same spaces."""

import json

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence as same

import flag_env  # noqa: F401
from flag_env.envs import config
from flag_env.envs.config import DEFAULT_SCENE, FlagConfig
from flag_env.envs.sb3 import FlagSB3VecEnv
from flag_env.physics import describe, presets, tune
from flag_env.physics.integrators import RK4

IDS = ("Flag-v0", "FlagGoal-v0", "FlagGoalDense-v0")


def episode(env, target=1):
    trace = [env.reset(seed=0, options={"target": target})]
    return trace + [env.step(np.full(env.action_space.shape, 0.5, np.float32)) for _ in range(10)]


def test_the_default_is_balanced_to_the_bit():
    """1 mm in one second asks for no more than the shipped targets' scene either."""
    for accuracy in (None, "balanced", 1e-3):
        assert FlagConfig(accuracy=accuracy).resolved_scene() == DEFAULT_SCENE
    assert tune(presets.flag(10, 16), "balanced", multiple_of=0.04) == DEFAULT_SCENE
    assert same(episode(gymnasium.make("Flag-v0")), episode(gymnasium.make("Flag-v0", accuracy="balanced")))


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("accuracy", ["fast", "reference"])
def test_every_id_takes_every_accuracy_with_the_same_spaces(env_id, accuracy):
    env, default = gymnasium.make(env_id, accuracy=accuracy), gymnasium.make(env_id)
    assert env.observation_space == default.observation_space
    assert env.action_space == default.action_space
    shape = {"fast": (1, 5, 8), "reference": (1, 10, 16)}[accuracy]
    assert env.unwrapped.simulator.scene.lattice.shape == shape
    trace = episode(env)
    assert all(env.observation_space.contains(step[0]) for step in trace)
    many = gymnasium.make_vec(env_id, 2, vectorization_mode="vector_entry_point", accuracy=accuracy)
    many.reset(seed=0, options={"target": 1})
    for step in trace[1:]:
        observation, *_, info = many.step(np.full(many.action_space.shape, 0.5, np.float32))
        assert same(step[0], {k: v[1] for k, v in observation.items()} if env_id != "Flag-v0" else observation[1])
        assert info["distance"][1] == step[4]["distance"]


@pytest.mark.parametrize("accuracy", ["fast", "reference"])
@pytest.mark.parametrize("control", ["wind", "mast"])
def test_witnesses_succeed_at_every_accuracy(accuracy, control):
    """Targets are where they lead at that accuracy, close to where they lead in the default scene."""
    env = gymnasium.make("Flag-v0", control=control, accuracy=accuracy, split="test").unwrapped
    env.reset(seed=0, options={"target": 2})
    for action in env.library.actions(2):
        *_, info = env.step(action)
    assert info["distance"] == 0.0
    corners = np.ix_([0], [0, -1], [0, -1])
    shift = env.target[corners] - np.asarray(env.library.positions[2])[corners]
    assert np.linalg.norm(shift, axis=-1).max() < {"fast": 0.25, "reference": 2e-3}[accuracy]


def test_a_scene_is_taken_as_it_is_unless_told():
    scene = presets.flag(10, 16, stiffness=200.0)
    taken, tuned = FlagConfig(scene=scene).resolved_scene(), FlagConfig(scene=scene, accuracy="reference").resolved_scene()
    assert (taken.integrator, taken.dtype, taken.effects) == (scene.integrator, scene.dtype, scene.effects)
    assert (tuned.integrator, tuned.dtype, tuned.effects) == (RK4(), "float64", scene.effects)


def test_a_tolerance_in_metres_is_kept_on_the_control_step():
    scene = FlagConfig(accuracy=1e-5).resolved_scene()
    assert 0.04 / scene.timestep == pytest.approx(round(0.04 / scene.timestep), abs=1e-9)
    blown = FlagConfig(accuracy=1e-5).resolved_scene().adding(*config.blown(DEFAULT_SCENE).effects)
    assert blown == tune(config.blown(DEFAULT_SCENE), 1e-5, multiple_of=0.04)
    assert describe(blown).error <= 1e-5


def test_stable_baselines_takes_it():
    env = FlagSB3VecEnv(2, accuracy="fast")
    assert env.env.simulator.scene.lattice.shape == (1, 5, 8)


def test_spec_is_json():
    for accuracy in ("fast", 1e-4):
        spec = gymnasium.make("Flag-v0", accuracy=accuracy).spec
        assert json.loads(spec.to_json())["kwargs"]["accuracy"] == accuracy


@pytest.mark.parametrize(
    ("accuracy", "error", "message"),
    [
        ("best", ValueError, r"accuracy must be one of 'fast', 'balanced', 'reference', got 'best'"),
        (0.0, ValueError, r"accuracy must be finite and > 0, got 0.0"),
        (True, TypeError, r"accuracy must be a number, got True"),
        ([1e-3], TypeError, r"accuracy must be a number, got \[0.001\]"),
    ],
)
def test_bad_accuracies_are_named(accuracy, error, message):
    with pytest.raises(error, match=message):
        gymnasium.make("Flag-v0", accuracy=accuracy)
