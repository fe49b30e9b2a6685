"""A control, a level and targets from outside join every environment, or are refused by name."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import flag_env  # noqa: F401
from flag_env.control import MastControl, WindControl
from flag_env.envs.certify import certified
from flag_env.envs.sb3 import FlagSB3VecEnv
from flag_env.tasks import Level, load_targets


class SoftControl(WindControl):
    """Wind control under another name."""


LEVEL = Level("gale", hidden_wind=(6.0, 8.0, 6.0))


@pytest.fixture(scope="module")
def targets():
    return certified(SoftControl, LEVEL, 6, np.random.default_rng(5))


def test_every_environment_takes_them_and_every_witness_reaches_its_target(targets):
    single = gymnasium.make("Flag-v0", control=SoftControl, level=LEVEL, targets=targets)
    for target in range(len(targets)):
        single.reset(options={"target": target})
        for action in single.unwrapped.witness():
            info = single.step(action)[4]
        assert info["is_success"]
    goal = gymnasium.make("FlagGoal-v0", control=SoftControl, level=LEVEL, targets=targets)
    assert goal.unwrapped.library is targets or np.array_equal(goal.unwrapped.library.wind, targets.wind)
    many = FlagSB3VecEnv(2, control=SoftControl, level=LEVEL, targets=targets)
    assert many.env.library is targets
    assert np.abs(targets.wind).max(axis=0) == pytest.approx(LEVEL.hidden_wind, rel=0.6)
    assert (np.abs(targets.wind) <= LEVEL.hidden_wind).all()


def test_a_library_file_is_the_shipped_library():
    path = Path(str(files("flag_env.tasks"))) / "data" / "wind_calm.npz"
    env = gymnasium.make("Flag-v0", targets=str(path), split="test")
    np.testing.assert_array_equal(env.unwrapped.library.positions, load_targets("wind", "calm", "test").positions)


def test_without_poses_targets_are_where_witnesses_lead(targets):
    blind = replace(targets, positions=np.zeros(0))
    shown, found = (
        gymnasium.make("Flag-v0", control=SoftControl, level=LEVEL, targets=library).unwrapped for library in (targets, blind)
    )
    for env in (shown, found):
        env.reset(options={"target": 2})
    np.testing.assert_allclose(found.target, shown.target, atol=2.0**-13)  # half of what shipped poses are rounded to


def test_what_does_not_fit_is_refused_by_name(targets):
    make = gymnasium.make
    with pytest.raises(ValueError, match="targets must be given with a control or level of your own"):
        make("Flag-v0", control=SoftControl)
    with pytest.raises(ValueError, match="targets must be given with a control or level of your own"):
        make("Flag-v0", level=LEVEL)
    with pytest.raises(ValueError, match="targets must have witnesses of 75 steps of 5 entries"):
        make("Flag-v0", control=MastControl, targets=targets)
    with pytest.raises(TypeError, match="targets must be Targets or the path of a library file"):
        make("Flag-v0", targets=3)
    with pytest.raises(ValueError, match="control must be one of"):
        make("Flag-v0", control=object)
    with pytest.raises(ValueError, match="hidden_wind"):
        Level("gale", hidden_wind=(1.0, 2.0))
