"""Videos: what is written is read back; what fails leaves the old file."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from PIL import Image
from render_flags import lattice
from scipy.ndimage import uniform_filter

from flag_env.render import Renderer, write_video


def names(folder):
    return [entry.name for entry in folder.iterdir()]


def frames(count=5, height=24, width=40):
    for number in range(count):
        frame = np.full((height, width, 3), 230, dtype=np.uint8)
        frame[4:12, 4 + 3 * number : 12 + 3 * number] = (200, 40, 30)
        yield frame


def test_gif_round_trip(tmp_path):
    path = write_video(frames(), tmp_path / "flag.gif", fps=25)
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert image.n_frames == 5
        assert image.size == (40, 24)
        assert image.info["duration"] == 40
        assert image.info["loop"] == 0
        for number, expected in enumerate(frames()):
            image.seek(number)
            read = np.asarray(image.convert("RGB")).astype(int)
            assert np.abs(read - expected).max() <= 8
    assert names(tmp_path) == ["flag.gif"]


def test_new_colours_in_later_frames_survive(tmp_path):
    pictures = [np.full((8, 8, 3), color, dtype=np.uint8) for color in ((250, 250, 250), (10, 160, 60), (30, 60, 200))]
    path = write_video(pictures, tmp_path / "a.gif", fps=10)
    with Image.open(path) as image:
        for number, expected in enumerate(pictures):
            image.seek(number)
            assert np.abs(np.asarray(image.convert("RGB")).astype(int) - expected).max() <= 16


def test_mp4(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    path = write_video(frames(), str(tmp_path / "flag.mp4"), fps=25)
    assert path.stat().st_size > 200
    assert b"ftyp" in path.read_bytes()[:16]
    assert names(tmp_path) == ["flag.mp4"]


def test_mp4_without_its_packages_names_the_extra(tmp_path, monkeypatch):
    real = importlib.import_module

    def missing(name, package=None):
        if name.startswith("imageio"):
            raise ImportError(name)
        return real(name, package)

    monkeypatch.setattr("flag_env.render.recording.import_module", missing)
    with pytest.raises(ImportError, match=r"\[training\]"):
        write_video(frames(), tmp_path / "flag.mp4", fps=25)
    assert names(tmp_path) == []


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_a_failure_midway_leaves_the_old_file(tmp_path, suffix):
    if suffix == "mp4":
        pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / f"flag.{suffix}"
    path.write_bytes(b"old")

    def failing():
        yield from frames(2)
        raise RuntimeError("midway")

    with pytest.raises(RuntimeError, match="midway"):
        write_video(failing(), path, fps=10)
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == [path.name]


@pytest.mark.parametrize(
    ("pictures", "words"),
    [
        ([], "empty"),
        ([np.zeros((4, 4, 3))], r"frames\[0\].*float64.*uint8"),
        ([np.zeros((4, 4), np.uint8)], r"frames\[0\].*\(4, 4\)"),
        (
            [np.zeros((4, 4, 3), np.uint8), np.zeros((4, 5, 3), np.uint8)],
            r"frames\[1\].*\(4, 5, 3\).*\(4, 4, 3\)",
        ),
        ([None], "frames.*NoneType"),
    ],
)
def test_refuses_frames(tmp_path, pictures, words):
    with pytest.raises(ValueError, match=words):
        write_video(pictures, tmp_path / "flag.gif", fps=10)
    assert names(tmp_path) == []


@pytest.mark.parametrize(("name", "fps", "words"), [("a.avi", 10, r"a\.avi.*\.gif or \.mp4"), ("a.gif", 0, "fps.*0")])
def test_refuses_suffix_and_rate(tmp_path, name, fps, words):
    with pytest.raises(ValueError, match=words):
        write_video(frames(), tmp_path / name, fps=fps)


def test_the_file_has_ordinary_permissions(tmp_path):
    path = write_video(frames(), tmp_path / "flag.gif", fps=10)
    (tmp_path / "plain").touch()
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_tones_come_back_and_what_stands_still_costs_nothing(make, tmp_path):
    """Averaged over 9 x 9 pixels, so that the grain cancels, colours are the right ones: no bands, no wrong hues."""
    renderer = Renderer(240, 240)
    target = lattice(wave=-0.2)
    pictures = [renderer.draw(make(positions=lattice(wave=0.03 * k - 0.4), target=target)) for k in range(24)]
    path = write_video(pictures, tmp_path / "flag.gif", fps=25)
    with Image.open(path) as image:
        for number in (0, 12, 23):
            image.seek(number)
            read = np.asarray(image.convert("RGB")).astype(float)
            error = uniform_filter(read - pictures[number], (9, 9, 1))
            assert np.percentile(np.abs(error), 99) < 3.7
            assert np.sqrt((error**2).mean()) < 1.6
    still = write_video(pictures[:1], tmp_path / "one.gif", fps=25).stat().st_size
    assert write_video(pictures[:1] * 12, tmp_path / "still.gif", fps=25).stat().st_size < 1.1 * still
