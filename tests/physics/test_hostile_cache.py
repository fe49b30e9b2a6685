"""A cache never stops a run: on machines where it cannot be read or written, the same numbers come out, with one warning."""

import os
import subprocess
import sys
import time

import pytest

from flag_env.physics.compiling import disk_cache
from tests.conftest import ROOT

FALL = """
from flag_env.physics import Lattice, Scene, Simulator
from flag_env.physics.effects import Gravity
from flag_env.physics.integrators import Leapfrog
sim = Simulator(Scene(Lattice(1, 1, 1, pinned="none"), (Gravity(8.0),), Leapfrog(), timestep=0.125))
sim.step(1)
assert sim.positions[0, 0, 0, 0, 2] == -0.125
print("fell")
"""

LIMITED = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))\n"
"""No file may grow beyond so many bytes, as with a quota: writing more is an OSError."""


def warned(told):
    assert "fell" in told
    return told.count("RuntimeWarning: cache: ")


def code(files):
    """Without the mark that compiling has been tried there."""
    return [path for path in files if path.name != "fast"]


def kept(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def fall(run_stranger, tmp_path):
    """Function that lets a particle fall in a process of a stranger and tells the number of warnings."""
    return lambda before="", **environment: warned(run_stranger(before + FALL, tmp_path, **environment))


def test_no_home_no_name_and_no_room_anywhere(fall, tmp_path):
    assert fall(LIMITED.format(0)) == 1
    assert kept(tmp_path) == []


def test_no_home_and_no_name(fall, tmp_path):
    """The temporary folder is left, and has room."""
    (tmp_path / "closed").mkdir(mode=0o555)
    assert fall(TMPDIR=str(tmp_path), NUMBA_CACHE_DIR=str(tmp_path / "closed")) == 0
    files = kept(tmp_path)
    assert files
    assert fall(TMPDIR=str(tmp_path)) == 0
    assert kept(tmp_path) == files


def test_a_full_disk_a_quota_and_then_room(fall, tmp_path):
    assert fall(LIMITED.format(6000), NUMBA_CACHE_DIR=str(tmp_path)) == 1
    partly = kept(tmp_path)
    assert all(
        path.suffix == ".code" and disk_cache.load_from_disk(path) is not None for path in code(partly)
    )  # whole ones, and nothing else
    assert fall(NUMBA_CACHE_DIR=str(tmp_path)) == 0
    files = kept(tmp_path)
    assert set(files) > set(partly)
    # Now each file is damaged in one of the ways of a crash or a bad disk.
    before = {path: path.read_bytes() for path in code(files)}
    for number, (path, content) in enumerate(before.items()):
        flipped = bytes([content[0], *content[1:-9], content[-9] ^ 16, *content[-8:]])
        path.write_bytes((b"", content[: len(content) // 2], flipped, b"\x80\x04\x95" * 50)[number % 4])
    assert fall(NUMBA_CACHE_DIR=str(tmp_path)) == 1
    assert set(kept(tmp_path)) >= set(files)  # and what had been within a part that was kept whole
    files = kept(tmp_path)
    assert all(disk_cache.load_from_disk(path) is not None for path in code(files))
    for path in code(files):
        disk_cache.keep_on_disk(path, b"whole, and yet no code")
    assert fall(NUMBA_CACHE_DIR=str(tmp_path)) == 1
    assert fall(NUMBA_CACHE_DIR=str(tmp_path)) == 0
    # A file stands where the folder should, and the folder may not be written to.
    folder = files[0].parent
    for path in kept(tmp_path):
        path.unlink()
    folder.chmod(0o555)
    assert fall(NUMBA_CACHE_DIR=str(tmp_path)) == 1
    folder.chmod(0o755)
    folder.rmdir()
    folder.touch()
    assert fall(NUMBA_CACHE_DIR=str(tmp_path)) == 1


def test_processes_that_compile_at_the_same_time_and_are_killed(fall, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path)}
    many = [subprocess.Popen([sys.executable, "-W", "error", "-c", FALL], env=environment) for _ in range(3)]
    while not kept(tmp_path):
        assert many[0].poll() is None
        time.sleep(0.01)
    many[0].kill()
    assert [process.wait(300) for process in many][1:] == [0, 0]
    files = [path for path in kept(tmp_path) if path.suffix == ".code" and not path.name.startswith(".")]
    assert all(disk_cache.load_from_disk(path) is not None for path in code(files))
    assert fall(NUMBA_CACHE_DIR=str(tmp_path)) == 0


def test_a_temporary_folder_that_another_made_is_not_trusted(tmp_path, monkeypatch):
    monkeypatch.setattr(disk_cache.tempfile, "tempdir", str(tmp_path))
    (place,) = disk_cache._temporary()
    assert place.parent == tmp_path
    place.chmod(0o777)  # everyone may put code there
    assert disk_cache._temporary() == []
