"""Environments made with keyword arguments drawn by hypothesis: any that fit give an environment that keeps its promises, any
that do not are refused by name. The short form draws scenes whose steps are compiled anyway; the long form draws the others too.
"""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import load_env_creator
from gymnasium.utils.env_checker import data_equivalence as same
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import flag_env  # noqa: F401
from flag_env.envs.config import SCENES
from flag_env.physics import effects, presets
from flag_env.physics.accuracy.tuning import ACCURACIES
from flag_env.tasks import LEVELS, SPLITS

UNHURRIED = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}
IDS = {"Flag-v0": ("shaped", "dense", "sparse"), "FlagGoal-v0": ("sparse", "dense"), "FlagGoalDense-v0": ("dense", "sparse")}

FLAGS = st.builds(
    presets.flag,
    st.integers(1, 6),
    st.integers(1, 8),
    taper=st.floats(0.05, 1.5),
    stiffness=st.floats(1.0, 1e4),
    viscosity=st.floats(1e-4, 1.0),
    pinned=st.sampled_from(["edge", "sleeve", "ends"]),
)
PLAIN = st.tuples(st.just("flag"), st.sampled_from([None, "fast", "balanced"])) | st.tuples(
    FLAGS, st.sampled_from([None, "fast"])
)
OTHERS = (
    st.tuples(st.sampled_from(SCENES), st.sampled_from([None, "fast", "balanced", "reference"]))
    | st.tuples(st.just("flag"), st.floats(-6.0, -2.0).map(lambda exponent: 10**exponent))
    | st.tuples(FLAGS, st.sampled_from([1e-4, "reference"]))
    | st.tuples(st.builds(presets.storm_flag, st.integers(2, 6), st.integers(2, 8)), st.sampled_from([None, "balanced"]))
)


@st.composite
def arguments(draw, scenes):
    env_id = draw(st.sampled_from(list(IDS)))
    scene, accuracy = draw(scenes)
    return env_id, {
        "control": draw(st.sampled_from(["wind", "mast"])),
        "level": draw(st.sampled_from(["calm", "breeze"])),
        "split": draw(st.sampled_from(SPLITS[:3])),
        "scene": scene,
        "accuracy": accuracy,
        "tolerance": draw(st.floats(1e-9, 1e9)),
        "reward": draw(st.sampled_from(IDS[env_id])),
        "render_mode": draw(st.sampled_from([None, "rgb_array"])),
        "width": draw(st.integers(64, 90)),
        "height": draw(st.integers(64, 90)),
    }


def make(env_id, many=False, **kwargs):
    """The environment itself, without wrappers, as `gymnasium.make` or `make_vec` would make it."""
    spec = gymnasium.spec(env_id)
    entry = spec.vector_entry_point if many else spec.entry_point
    return load_env_creator(entry)(**{**spec.kwargs, **kwargs})


def keeps_its_promises(env_id, kwargs, seed):
    env = make(env_id, **kwargs)
    random = np.random.default_rng(seed)
    target = int(random.integers(LEVELS[kwargs["level"]].sizes[kwargs["split"]]))
    observation, info = env.reset(seed=seed, options={"target": target})
    assert env.observation_space.contains(observation)
    assert info["target"] == target
    twin = pickle.loads(pickle.dumps(env))
    many = make(env_id, many=True, num_envs=2, **kwargs)
    assert same(first_of(many.reset(seed=seed, options={"target": target})[0]), observation)
    trace = []
    for scale in (1.0, 1.0, 1e6):
        action = (scale * random.uniform(-1, 1, env.action_space.shape)).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        trace.append((observation, reward))
        assert env.observation_space.contains(observation)
        assert type(reward) is float
        assert np.isfinite(reward)
        assert reward == pytest.approx(sum(term for name, term in info.items() if name.startswith("reward_")), rel=1e-12)
        assert (terminated, truncated, info["diverged"]) == (False, False, False)
        assert np.isfinite(info["distance"])
        assert same(twin.step(action), (observation, reward, terminated, truncated, info))
        beside = many.step(np.stack([action, -action]))
        assert same(first_of(beside[0]), observation)
        assert beside[1][0] == reward
    if kwargs["render_mode"] is None:
        with pytest.warns(UserWarning, match="render_mode"):
            assert env.render() is None
    else:
        assert env.render().shape == (kwargs["height"], kwargs["width"], 3)
    for one in (env, many):
        one.close()
        one.close()


def first_of(observation):
    return {name: part[0] for name, part in observation.items()} if isinstance(observation, dict) else observation[0]


@given(case=arguments(PLAIN), seed=st.integers(0, 2**31))
@settings(max_examples=30, **UNHURRIED)
def test_arguments_that_fit(case, seed):
    keeps_its_promises(*case, seed)


@pytest.mark.slow
@given(case=arguments(OTHERS), seed=st.integers(0, 2**31))
@settings(max_examples=60, phases=(Phase.generate,), **UNHURRIED)  # to shrink an example would compile for an hour
def test_arguments_that_fit_other_scenes_too(case, seed):
    keeps_its_promises(*case, seed)


THINGS = st.none() | st.booleans() | st.integers() | st.floats() | st.binary() | st.lists(st.integers(), max_size=2)
ARRAYS = st.just(np.array(["wind", "calm"])) | st.just(np.zeros(2)) | st.just(np.array([]))
NO_NUMBERS = st.text() | st.none() | st.booleans() | st.binary() | st.lists(st.floats(), max_size=2) | ARRAYS
NO_POSITIVE = st.floats(max_value=0.0) | st.sampled_from([np.nan, np.inf]) | st.integers(max_value=0)
NO_SIZE = THINGS.filter(lambda value: type(value) is not int or not 64 <= value <= 8192) | st.text() | ARRAYS


def words(*allowed):
    return st.text().filter(lambda text: text not in allowed) | THINGS | ARRAYS


def bad(env_id):
    """Values that an argument must refuse."""
    return {
        "control": words("wind", "mast", "both", "wind+frequency", "mast+yaw"),
        "level": words(*LEVELS),
        "split": words(*SPLITS),
        "reward": words(*IDS[env_id], "track", "snap").filter(lambda value: value is not None),  # None: the id's own, in vectors
        "scene": words(*SCENES).filter(lambda value: value is not None) | st.just(presets.flag(3, 4).without(effects.CosineWind)),
        "accuracy": NO_POSITIVE
        | st.just(1e-30)
        | NO_NUMBERS.filter(lambda value: value is not None and str(value) not in ACCURACIES),
        "tolerance": NO_POSITIVE | NO_NUMBERS,
        "render_mode": words("rgb_array").filter(lambda value: value is not None),
        "width": NO_SIZE,
        "height": NO_SIZE,
    }


VECTOR = {
    "num_envs": NO_POSITIVE | NO_NUMBERS,
    "max_episode_steps": NO_POSITIVE | NO_NUMBERS,
    "threads": NO_POSITIVE | NO_NUMBERS.filter(lambda value: value is not None),
    "autoreset_mode": words("NextStep", "SameStep", "Disabled"),
}


@given(data=st.data())
@settings(max_examples=300, **UNHURRIED)
def test_arguments_that_do_not_fit_are_refused_by_name(data):
    env_id = data.draw(st.sampled_from(list(IDS)))
    many = data.draw(st.booleans())
    values = {**bad(env_id), **(VECTOR if many else {})}
    name = data.draw(st.sampled_from(list(values)))
    value = data.draw(values[name])
    with pytest.raises((ValueError, TypeError), match=name):
        make(env_id, many=many, **{name: value})
