"""The core of an installed package: an environment, many of them, a scene, a target of each library, a picture, its own words."""

from importlib import metadata
from importlib.resources import files

import gymnasium
import numpy as np

import flag_env
from flag_env.envs.config import FlagConfig
from flag_env.physics import Simulator, presets
from flag_env.tasks import rungs
from flag_env.viewer import Replay, of_stage

env = gymnasium.make("Flag-v0", render_mode="rgb_array")
env.reset(seed=0)
env.step(env.action_space.sample())
assert env.render().shape == (480, 480, 3)

envs = gymnasium.make_vec("Flag-v0", num_envs=2, vectorization_mode="vector_entry_point")
envs.reset(seed=0)
assert np.isfinite(envs.step(envs.action_space.sample())[0]).all()

for control, level in rungs():
    assert len(FlagConfig(control=control, level=level, split="validation").library) == 128

simulator = Simulator(presets.storm_flag(rows=4, cols=6))
simulator.advance(0.05)
assert np.isfinite(simulator.positions).all()

about = metadata.metadata("flag_env")
assert about["Version"] == flag_env.__version__
assert {"cli", "training", "bench", "distributed", "docs", "test", "lint"} <= set(about.get_all("Provides-Extra"))
assert {point.name for point in metadata.distribution("flag_env").entry_points} >= {"flag-env", "flag-train"}
assert files("flag_env").joinpath("py.typed").is_file()
assert files("training").joinpath("hyperparams", "ppo.yml").is_file()

assert "<canvas" in Replay(of_stage("rope", 0.1)).html  # the page's files are in the package
