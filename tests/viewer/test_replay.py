"""Replays as files: their numbers come back, their size stays small, and nothing wrong is written."""

from __future__ import annotations

import base64
import html
import json
import re
import zlib

import numpy as np
import pytest

from flag_env.physics import presets
from flag_env.viewer import Motion, Replay, Task, of_episode, of_scene, of_stage, save
from flag_env.viewer.body import body
from flag_env.viewer.replay import GRID, encode


def decoded(text: str, planes: int, shape: tuple[int, ...], grid: float) -> np.ndarray:
    """Frames from what `encode` returns, by another way than the page's."""
    split = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(planes, 3, *shape)
    unsigned = sum(split[plane].astype(np.uint64) << np.uint64(8 * plane) for plane in range(planes))
    small = (unsigned // 2).astype(np.int64) * np.where(unsigned % 2, -1, 1) - (unsigned % 2).astype(np.int64)
    for axis in (4, 3, 1, 1):
        small = np.cumsum(small, axis=axis)
    return grid * np.moveaxis(small, 0, -1)


@pytest.mark.parametrize("shape", [(1, 1, 1, 1, 3), (5, 2, 3, 4, 3), (7, 1, 1, 9, 3)])
@pytest.mark.parametrize("size", [1e-5, 1.0, 1000.0])
def test_positions_come_back_to_half_a_step_of_the_grid(shape, size):
    frames = np.random.default_rng(0).normal(size=shape) * size
    text, planes = encode(frames, GRID)
    np.testing.assert_allclose(decoded(text, planes, shape[:-1], GRID), frames, atol=0.5001 * GRID)


@pytest.mark.parametrize(("stage", "largest"), [("flag", 200_000), ("two-layer", 350_000)])
def test_three_seconds_are_small(stage, largest):
    motion = of_stage(stage, 3.0)
    assert motion.frames.shape[0] == 75
    assert motion.frames.shape[2:4] == (20, 32)
    assert len(Replay(motion).html.encode()) < largest


def test_a_file_asks_for_nothing_and_runs_only_its_own_script():
    page = Replay(of_stage("rope", 0.2)).html
    assert not re.search(r"https?://|\bfetch\(|import\(|type=\"module\"|\bsrc=|eval\(", page)
    assert page.count("</script>") == 3
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in policy


def test_what_is_told_cannot_leave_its_place():
    evil = '</script><script>alert(1)</script><!-- " & <b>'
    page = Replay(of_scene(presets.rope(4), 0.1, title=evil, told=evil)).html
    assert "alert(1)</script>" not in page
    about = json.loads(re.search(r'id="about">(.*?)</script>', page)[1])
    assert about["title"] == about["told"] == evil
    framed = Replay(of_scene(presets.rope(4), 0.1, title=evil))._repr_html_()
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', framed)[1]).startswith("<!doctype html>")


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e12])
def test_frames_that_cannot_be_kept_are_refused_and_nothing_is_written(tmp_path, bad):
    scene = presets.flag(3, 4)
    frames = np.zeros((2, 1, 3, 4, 3))
    frames[1, 0, 2, 3, 1] = bad
    with pytest.raises(ValueError, match="frames must"):
        save(Motion(body(scene), frames, 25.0, "bad"), tmp_path / "bad.html")
    assert list(tmp_path.iterdir()) == []


def test_names_and_emptiness_are_refused(tmp_path):
    motion = of_scene(presets.rope(4), 0.1)
    with pytest.raises(ValueError, match=r"\.html"):
        Replay(motion).save(tmp_path / "x.txt")
    with pytest.raises(ValueError, match="frames must have the shape"):
        Replay(Motion(motion.body, np.zeros((0, 1, 1, 4, 3)), 25.0, "none"))


def test_a_scene_moves_at_its_pace():
    motion = of_stage("report-1", 0.4)
    assert motion.frames.shape[0] == 10
    assert motion.pace == 0.1
    assert np.abs(motion.frames[-1] - motion.frames[0]).max() > 0.1


def test_an_episode_carries_target_distance_and_wind(tmp_path):
    motion = of_episode(Task(), "witness", 5)
    assert len(motion.frames) == len(motion.distance) == len(motion.wind) == 76
    gap = motion.frames - motion.target
    rms = np.sqrt((gap**2).sum(axis=-1).mean(axis=(1, 2, 3))) / np.hypot(*motion.body["extent"])
    np.testing.assert_allclose(motion.distance, rms, atol=1e-4)
    assert motion.distance[-1] < motion.tolerance
    assert save(motion, tmp_path / "a.gif", 64).read_bytes()[:3] == b"GIF"
