"""Files are written whole or not at all."""

import json
from concurrent.futures import ThreadPoolExecutor

import pytest

from flag_env._files import check_file, check_folder, machine, read_json, replacing, write_bytes, write_json


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "model.zip"
    write_bytes(path, b"old")

    def write_half() -> None:
        with replacing(path) as partial:
            partial.write_bytes(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_replaces_the_old_file_and_makes_folders(tmp_path):
    path = tmp_path / "new" / "result.json"
    write_json(path, {"a": 1})
    write_json(path, {"a": [2.5, None]})
    assert read_json(path) == {"a": [2.5, None]}
    assert list(path.parent.iterdir()) == [path]


def test_json_refuses_what_is_no_json(tmp_path):
    with pytest.raises(ValueError, match="Out of range float"):
        write_json(tmp_path / "result.json", {"distance": float("inf")})
    assert list(tmp_path.iterdir()) == []


def test_the_machine_is_described():
    told = json.loads(json.dumps(machine()))
    assert told.keys() == {"processor", "cores", "system", "versions", "date"}
    assert all(isinstance(value, str) and value for value in told["versions"].values())


def test_writers_at_the_same_time_do_not_mix(tmp_path):
    path = tmp_path / "result"
    contents = [bytes([number]) * 100_000 for number in range(8)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda content: write_bytes(path, content), contents * 4))
    assert path.read_bytes() in contents
    assert list(tmp_path.iterdir()) == [path]


def test_a_written_file_has_the_usual_permissions(tmp_path):
    (tmp_path / "usual").touch()
    write_bytes(tmp_path / "ours", b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_place_is_checked_and_nothing_made(tmp_path):
    (tmp_path / "file").touch()
    assert check_folder("output", tmp_path / "a" / "b") == tmp_path / "a" / "b"
    assert check_file("results", tmp_path / "a" / "b.json", (".json",)) == tmp_path / "a" / "b.json"
    for bad in (tmp_path / "file", tmp_path / "file" / "below", tmp_path / "file" / "a" / "b"):
        with pytest.raises(ValueError, match=f"output must be a folder.*got {bad}"):
            check_folder("output", bad)
    with pytest.raises(ValueError, match=r"results must be a name that ends in .json, got .*b.txt"):
        check_file("results", tmp_path / "b.txt", (".json",))
    with pytest.raises(ValueError, match=r"results must be a file, got .*, which is a folder"):
        check_file("results", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_place_without_permission_is_refused(tmp_path, run_stranger):
    script = """
from pathlib import Path
from flag_env._files import check_folder
try:
    check_folder("output", Path("closed/new"))
except ValueError as error:
    print(error)
"""
    (tmp_path / "closed").mkdir(mode=0o555)
    assert "closed/new (Permission denied)" in run_stranger(script, tmp_path)
