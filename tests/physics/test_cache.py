"""Checks that compiled code kept on disk is used again, and never after a source it was made from has changed."""

import shutil
from pathlib import Path

import pytest

import flag_env.physics

FALL = """
from flag_env.physics import Lattice, Scene, Simulator
from flag_env.physics.effects import Gravity
from flag_env.physics.integrators import Leapfrog
sim = Simulator(Scene(Lattice(1, 1, 1, pinned="none"), (Gravity(8.0),), Leapfrog(), timestep=0.125))
sim.step(1)
print(sim.positions[0, 0, 0, 0, 2])
import flag_env
print(flag_env.__path__[0])
"""

FOREIGN = """
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from flag_env.physics.effects import Effect, LinearBound
from flag_env.physics.compiling import jit

@jit
def _force(data, copy, x, v, f, effect_work, lag):
    for t in range(f.shape[1]):
        f[0, t] += 2.0 * data.push

class PushData(NamedTuple):
    push: float
    force = staticmethod(_force)

@dataclass(frozen=True)
class Push(Effect):
    push: float = 1.0

    def bind(self, context):
        return PushData(self.push)

    def linear_bound(self, lattice):
        return LinearBound()
"""

PUSHED = """
from foreign import Push
from flag_env.physics import Lattice, Scene, Simulator
from flag_env.physics.integrators import Leapfrog
sim = Simulator(Scene(Lattice(1, 1, 1, mass=0.5, pinned="none"), (Push(4.0),), Leapfrog(), timestep=0.125))
sim.step(1)
print(sim.positions[0, 0, 0, 0, 0])
"""


@pytest.fixture
def copy_of_package(tmp_path):
    source = Path(flag_env.physics.__file__).parents[1]
    shutil.copytree(source / "physics", tmp_path / "flag_env" / "physics", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(source / "_files.py", tmp_path / "flag_env")
    (tmp_path / "flag_env" / "__init__.py").touch()
    shutil.copy(source / "_validate.py", tmp_path / "flag_env")
    return tmp_path


def compiled_files(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.code")}


def test_an_edited_kernel_is_compiled_anew_and_an_unedited_one_is_not(copy_of_package, run_python):
    cache = copy_of_package / "cache"

    def fall():
        position, package = run_python(FALL, copy_of_package, NUMBA_CACHE_DIR=str(cache)).split()
        assert Path(package) == copy_of_package / "flag_env"
        return float(position), compiled_files(cache)

    position, files = fall()
    assert position == -8.0 * 0.125**2
    assert files
    assert fall() == (position, files)

    gravity = copy_of_package / "flag_env" / "physics" / "effects" / "gravity.py"
    text = gravity.read_text()
    assert text.count("f[t] -= weight[t]") == 1
    gravity.write_text(text.replace("f[t] -= weight[t]", "f[t] -= 2 * weight[t]"))
    edited, more = fall()
    assert edited == 2 * position
    assert more.items() > files.items()
    assert fall() == (edited, more)


def test_an_effect_from_outside_is_compiled_kept_and_renewed(copy_of_package, run_python):
    cache = copy_of_package / "cache"
    foreign = copy_of_package / "foreign.py"

    def pushed():
        return float(run_python(PUSHED, copy_of_package, NUMBA_CACHE_DIR=str(cache))), compiled_files(cache)

    foreign.write_text(FOREIGN)
    position, files = pushed()
    assert position == 0.125**2 * 2 * 4.0 / 0.5
    assert files
    assert pushed() == (position, files)

    foreign.write_text(FOREIGN.replace("2.0 * data.push", "3.0 * data.push"))
    edited, more = pushed()
    assert edited == 1.5 * position
    assert more.items() > files.items()


TWO = f"""{FOREIGN}
from flag_env.physics import Lattice, Scene, Simulator, effects, integrators
lattice = Lattice(1, 1, 1, mass=0.5, pinned="none")
sim = Simulator(Scene(lattice, (Push(4.0),), integrators.RK4(), timestep=0.125))
sim.step(1)

class PullData(NamedTuple):
    push: float
    force = staticmethod(_force)

@dataclass(frozen=True)
class Pull(Push):
    def bind(self, context):
        return PullData(-self.push)

other = Simulator(Scene(lattice, (Push(4.0), Pull(4.0)), integrators.RK4(), timestep=0.125))
other.step(1)
print(sim.positions[0, 0, 0, 0, 0], other.positions[0, 0, 0, 0, 0])
"""

FALL_BY_RK4 = """
from flag_env.physics import Lattice, Scene, Simulator, effects, integrators
sim = Simulator(Scene(Lattice(1, 1, 1, pinned="none"), (effects.Gravity(8.0),), integrators.RK4(), timestep=0.125))
sim.step(1)
print(sim.positions[0, 0, 0, 0, 2])
"""


def test_a_script_with_effects_of_its_own_runs_twice_and_leaves_the_package_to_others(copy_of_package, run_python):
    """What is kept names the types that it was compiled for, which another process, or a script's first lines, may not know."""
    (copy_of_package / "mine.py").write_text(TWO)
    keep = {"NUMBA_CACHE_DIR": str(copy_of_package / "cache")}
    moved = 0.125**2 / 2 * 2 * 4.0 / 0.5
    for start in (TWO, "import runpy; runpy.run_path('mine.py')", "import runpy; runpy.run_path('mine.py')"):
        positions = [float(word) for word in run_python(start, copy_of_package, **keep).split()]
        assert positions == pytest.approx([moved, 0.0], rel=1e-12, abs=1e-15)
    assert float(run_python(FALL_BY_RK4, copy_of_package, **keep)) == pytest.approx(-8.0 * 0.125**2 / 2, rel=1e-12)
