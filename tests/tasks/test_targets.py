"""The library of targets is read as it was built, or not at all, and replaced as a whole."""

import shutil
import signal
import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from flag_env import cli
from flag_env.control import CONTROLS
from flag_env.envs import certify
from flag_env.tasks import LEVELS, rungs
from flag_env.tasks.targets import SPLITS, read_seed, read_targets
from tests.conftest import ROOT

OWN = [(control, level) for control, level in rungs() if LEVELS[level].library is None]
SHIPPED = Path(str(files("flag_env.tasks"))) / "data"

SMALL = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
from flag_env.envs import certify, prove
from flag_env.tasks import LEVELS
for level in LEVELS.values():
    object.__setattr__(level, "splits", tuple((name, 2) for name in level.sizes))
certify._CHUNK = prove._CHUNK = 16
from flag_env.cli import main
main()
"""
"""The command, with two targets a split."""


SOME = ["wind/calm", "mast/breeze", "wind/snap"]


def command(output: Path, seed: int) -> list[str]:
    return [sys.executable, "-c", SMALL, "targets", "--output", str(output), "--seed", str(seed), "--only", *SOME]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", [f"{control}_{level}.npz" for control, level in OWN])
def test_the_shipped_library_tells_its_seed_and_fits_its_digests(name):
    assert read_seed(SHIPPED / name) == 0
    level = LEVELS[name.removesuffix(".npz").rpartition("_")[2]]
    assert {split: len(read_targets(SHIPPED / name, split)) for split in level.sizes} == level.sizes


def test_the_shipped_targets_are_drawn_from_the_seed_that_they_tell():
    rng = np.random.default_rng((0, 0, 0, SPLITS.index("test")))
    drawn = [certify._draw(CONTROLS["mast"], LEVELS["calm"], rng) for _ in range(2)]
    candidates = {(w.tobytes(), h.tobytes()) for part in drawn for w, h in zip(part.witnesses, part.wind, strict=True)}
    library = read_targets(SHIPPED / "mast_calm.npz", "test")
    assert {(w.tobytes(), h.tobytes()) for w, h in zip(library.witnesses, library.wind, strict=True)} < candidates


@pytest.mark.parametrize("what", ["seed", "test_wind", "test_witnesses", "test_positions", "spans"])
def test_a_library_that_was_changed_is_refused(tmp_path, what):
    path = tmp_path / "mast_calm.npz"
    with np.load(SHIPPED / path.name) as data:
        arrays = {name: data[name] for name in data.files}
    arrays[what] = arrays[what].copy()
    arrays[what].flat[0] += 1
    np.savez_compressed(path, allow_pickle=False, **arrays)
    with pytest.raises(ValueError, match=rf"{path.name} must hold test targets that fit its digest"):
        read_targets(path, "test")


@pytest.mark.parametrize("damage", ["nothing", "half", "no digest", "text"])
def test_a_damaged_library_is_named(tmp_path, damage):
    path = tmp_path / "mast_calm.npz"
    content = (SHIPPED / path.name).read_bytes()
    path.write_bytes({"nothing": b"", "half": content[: len(content) // 2], "text": b"text", "no digest": b""}[damage])
    if damage == "no digest":
        with np.load(SHIPPED / path.name) as data:
            np.savez(path, **{name: data[name] for name in data.files if "digest" not in name})
    with pytest.raises(ValueError, match=rf"{path.name} must be a whole library of targets"):
        read_targets(path, "test")


def refusal(*arguments, **keywords):
    with pytest.raises(SystemExit) as ended:
        cli.targets(*arguments, **keywords)
    return str(ended.value)


def test_what_cannot_be_done_is_refused_before_any_work(tmp_path):
    told = refusal(tmp_path, quick=True)
    assert told.startswith(f"error: output must hold a library of targets, got {tmp_path}, which lacks wind_calm.npz, ")
    assert refusal(tmp_path / "new", seed=-1) == "error: seed must be at least 0, got -1"
    (tmp_path / "file").touch()
    assert refusal(tmp_path / "file").startswith("error: output must be a folder")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    shutil.copytree(SHIPPED, tmp_path / "library")
    (tmp_path / "library" / ".building").mkdir()
    assert ".building is there: another build is at work, or was killed" in refusal(tmp_path / "library")
    with np.load(SHIPPED / "mast_calm.npz") as data:
        arrays = {name: data[name] for name in data.files if name != "seed" and not name.endswith("_digest")}
    certify.save(tmp_path / "library" / "mast_calm.npz", arrays, 3)
    assert "must hold a library of one seed" in refusal(tmp_path / "library", quick=True)


def test_a_build_that_ends_early_leaves_the_library_as_it_was(tmp_path):
    folder = tmp_path / "library"
    built = subprocess.run(command(folder, 1), cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)
    assert built.returncode == 0, built.stderr
    whole = contents(folder)
    assert whole.keys() == {f"{task.replace('/', '_')}.npz" for task in SOME}
    assert {read_seed(folder / name) for name in whole} == {1}
    for end, word in ((signal.SIGINT, f"interrupted; {folder} is as it was"), (signal.SIGTERM, "ended by a signal")):
        other = subprocess.Popen(command(folder, 2), cwd=ROOT, stderr=subprocess.PIPE, text=True)
        while not any(folder.glob(".building/*.npz")):
            assert other.poll() is None
            time.sleep(0.001)
        other.send_signal(end)
        assert word in other.communicate(timeout=60)[1]
        assert other.returncode == 1
        assert contents(folder) == whole


def test_a_failing_build_leaves_nothing(tmp_path):
    def fail() -> None:
        with certify.swapped(tmp_path / "library") as folder:
            (folder / "half.npz").touch()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert list(tmp_path.iterdir()) == []
