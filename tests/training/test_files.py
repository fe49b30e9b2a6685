"""Files are written whole or not at all."""

import json

import pytest

from training.files import read_json, replacing, versions, write_bytes, write_json


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


def test_versions_are_text():
    assert all(isinstance(value, str) and value for value in json.loads(json.dumps(versions())).values())
