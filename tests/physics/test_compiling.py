"""Both ways to compile give the same bits; a Numba without the names that speed it up is no obstacle, nor is a hostile disk."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

RUN = """
import hashlib, sys, warnings
warnings.simplefilter("error" if {strict} else "ignore")
{before}
import numpy as np
from flag_env.physics import Simulator, presets
from flag_env.physics.compiling import WAY
from flag_env.physics.effects import Structural, Gravity
from flag_env.physics.lattice import Lattice
from flag_env.physics.scene import Scene
effects = (Gravity(), Structural(500.0, 0.1)) if {sheet} else (Gravity(),)
scene = Scene(Lattice(1, 4, 21, dimensions=3 if {sheet} else 1), effects, timestep=1e-4)
simulator = Simulator(scene, copies=2)
simulator.step(40)
print(WAY, hashlib.sha256(simulator.positions.tobytes()).hexdigest())
"""

BROKEN = {
    "a module has gone": "import numba; del numba._dynfunc; sys.modules['numba._dynfunc'] = None",
    "a name of a module has gone": "import numba.core.codegen; del numba.core.codegen.JITCodeLibrary",
    "a pass has another name": (
        "import numba.core.compiler, numba.core.typed_passes as passes\n"
        "passes.NativeLowering = type('Lowering', (passes.NativeLowering,), {})"
    ),
    "a dispatcher takes other arguments": (
        "import numba.core.registry as registry\n"
        "class Other(registry.CPUDispatcher):\n"
        "    def __init__(self, py_func): super().__init__(py_func)\n"
        "registry.CPUDispatcher = Other"
    ),
}


def run(run_python, folder, way="", before="", strict=True, sheet=False):
    script = RUN.format(before=before, strict=strict, sheet=sheet)
    return run_python(script, NUMBA_CACHE_DIR=str(folder), FLAG_ENV_COMPILING=way).split()


@pytest.fixture(scope="module")
def fast(run_python, tmp_path_factory):
    """What the quick way computes."""
    way, bits = run(run_python, tmp_path_factory.mktemp("fast"), "fast")
    assert way == "fast"
    return bits


def test_both_ways_compute_the_same_bits(run_python, tmp_path):
    ways = [run(run_python, tmp_path, way, sheet=True) for way in ("plain", "fast")]
    assert [way for way, _ in ways] == ["plain", "fast"]
    assert ways[0][1] == ways[1][1]


def test_what_plain_numba_compiles_is_found_again(run_python, tmp_path, fast):
    assert run(run_python, tmp_path, "plain") == ["plain", fast]
    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nb[ic]")}
    assert {path.suffix for path in files} == {".nbi", ".nbc"}
    assert run(run_python, tmp_path, "plain") == ["plain", fast]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nb[ic]")} == files


@pytest.mark.parametrize("broken", BROKEN)
def test_where_numba_lacks_a_name_the_plain_way_takes_over(run_python, tmp_path, fast, broken):
    assert run(run_python, tmp_path, before=BROKEN[broken]) == ["plain", fast]


NEW_NUMBA = "import numba; numba.__version__ = '99.0.1'\n"
CRASH = "import os, llvmlite.binding; llvmlite.binding.parse_bitcode = lambda *_: os.abort()\n"


@pytest.mark.parametrize(("patch", "way"), [(NEW_NUMBA, "fast"), (NEW_NUMBA + CRASH, "plain")], ids=["works", "crashes"])
def test_a_numba_to_come_is_tried_in_a_process_of_its_own(run_python, tmp_path, fast, patch, way):
    (tmp_path / "sitecustomize.py").write_text(patch)
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    script = RUN.format(before="", strict=True, sheet=False)
    assert run_python(script, PYTHONPATH=path, NUMBA_CACHE_DIR=str(tmp_path), FLAG_ENV_COMPILING="").split() == [way, fast]


def test_the_quick_way_when_asked_for_says_what_it_lacks(run_python, tmp_path):
    with pytest.raises(AssertionError, match="cannot import name 'JITCodeLibrary'"):
        run(run_python, tmp_path, "fast", BROKEN["a name of a module has gone"])


def test_an_unknown_way_is_refused_by_name(run_python, tmp_path):
    with pytest.raises(AssertionError, match="FLAG_ENV_COMPILING must be 'plain', 'fast' or not set, got 'quick'"):
        run(run_python, tmp_path, "quick")


def test_damaged_files_of_plain_numba_are_mended(run_python, tmp_path, fast):
    """Index and code files, each empty, of something else, or cut short."""
    run(run_python, tmp_path, "plain")
    for damages in ((b"", b"no pickle"), (b"no pickle", None)):  # None: cut short
        for suffix in ("nbi", "nbc"):
            files = sorted(tmp_path.rglob(f"*.{suffix}"))
            assert len(files) > 1
            for number, file in enumerate(files):
                damage = damages[number % 2]
                file.write_bytes(file.read_bytes()[: file.stat().st_size // 2] if damage is None else damage)
        with pytest.raises(AssertionError, match="RuntimeWarning: cache: "):
            run(run_python, tmp_path, "plain")
        assert run(run_python, tmp_path, "plain", strict=False) == ["plain", fast]
    assert run(run_python, tmp_path, "plain") == ["plain", fast]


def test_plain_numba_survives_a_full_disk_and_no_place_at_all(run_stranger, tmp_path, fast):
    for limit in (6000, 0):  # bytes that a file may have
        before = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))"
        script = RUN.format(before=before, strict=False, sheet=False).replace('"ignore"', '"default"')
        told = run_stranger(script, ROOT, FLAG_ENV_COMPILING="plain", NUMBA_CACHE_DIR=str(tmp_path))
        assert f"plain {fast}" in told
        assert told.count("RuntimeWarning: cache: ") == 1
