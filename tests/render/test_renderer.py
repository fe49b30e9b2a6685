"""Frames: fresh, reproducible, and showing what they should."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from render_flags import BOUNDS, lattice

from flag_env.render import Renderer
from flag_env.render.camera import Camera
from flag_env.render.scenery import backdrop


def test_frame_is_a_fresh_uint8_array(renderer, make):
    first, second = renderer.draw(make()), renderer.draw(make())
    assert first.shape == (120, 160, 3)
    assert first.dtype == np.uint8
    assert first.flags.owndata
    assert first.flags.writeable
    assert not np.shares_memory(first, second)
    kept = second.copy()
    first[...] = 0
    renderer.draw(make(positions=lattice(wave=0.4)))
    np.testing.assert_array_equal(second, kept)


def test_same_snapshot_same_bytes_whatever_came_before(renderer, make):
    full = make(target=lattice(wave=-0.2), wind=[3, 1, 0], wind_scale=5.0, distance=0.1, tolerance=0.05)
    expected = Renderer(160, 120).draw(full)
    for other in (make(), make(bounds=2.0 * BOUNDS), make(mast=[[0.3, 0, 0], [0.5, 0, 1]])):
        renderer.draw(other)
        np.testing.assert_array_equal(renderer.draw(full), expected)


@pytest.mark.parametrize(
    "changes",
    [
        {"positions": lattice(wave=0.3)},
        {"target": lattice(wave=-0.2)},
        {"mast": [[0.2, 0.0, 0.0], [0.2, 0.0, 1.0]]},
        {"bounds": 1.5 * BOUNDS},
        {"wind": [2.0, 0.0, 0.0]},
        {"distance": 0.2},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_frame_shows_each_change(renderer, make, changes):
    assert np.any(renderer.draw(make()) != renderer.draw(make(**changes)))


def test_torn_cells_are_left_out_and_no_others(make):
    """In the middle of a torn cell the frame shows what stands behind the flag; in that of an intact one, the flag."""
    renderer, camera = Renderer(320, 240), Camera.framing(BOUNDS, 320, 240)
    corners = lattice(wave=0.05)
    intact = np.random.default_rng(0).random((1, 9, 15)) < 0.6
    middles = 0.25 * (corners[:, :-1, :-1] + corners[:, :-1, 1:] + corners[:, 1:, 1:] + corners[:, 1:, :-1])
    pixels = camera.project(middles)[0].reshape(-1, 2)
    nothing = renderer.draw(make(positions=corners, intact=np.zeros_like(intact)))
    for kept in (intact, np.ones_like(intact)):
        frame = renderer.draw(make(positions=corners, intact=kept))
        seen = np.array([np.any(frame[239 - int(y), int(x)] != nothing[239 - int(y), int(x)]) for x, y in pixels])
        np.testing.assert_array_equal(seen, kept.ravel())
    np.testing.assert_array_equal(renderer.draw(make()), renderer.draw(make(intact=np.ones_like(intact))))


@pytest.mark.parametrize("shape", [(1, 2, 2), (2, 3, 5), (1, 30, 80), (1, 1, 6)])
def test_any_torn_lattice_is_drawn(renderer, make, shape):
    intact = np.random.default_rng(0).random((shape[0], shape[1] - 1, shape[2] - 1)) < 0.5
    renderer.draw(make(positions=lattice(*shape), intact=intact, target=lattice(*shape)))


def test_frame_shows_wind_distance_tolerance_and_success(renderer, make):
    base = {"target": lattice(wave=-0.2), "wind": [2.0, 0, 0], "wind_scale": 5.0, "distance": 0.2}
    frame = renderer.draw(make(**base))
    for change in (
        {"wind": [0, 2.0, 0]},
        {"wind_scale": 9.0},
        {"distance": 0.1},
        {"tolerance": 0.05},
        {"success": True},
    ):
        assert np.any(renderer.draw(make(**base | change)) != frame), change


def test_ghost_turns_green_on_success(renderer, make):
    target = lattice() - np.array([0.0, 0.0, 0.9])
    plain = renderer.draw(make()).astype(int)
    missed = renderer.draw(make(target=target)).astype(int) - plain
    reached = renderer.draw(make(target=target, success=True)).astype(int) - plain
    assert missed[..., 2].sum() > missed[..., 1].sum()
    assert reached[..., 1].sum() > reached[..., 2].sum()


@pytest.mark.parametrize(
    "shape",
    [
        (1, 1, 1),
        (1, 1, 2),
        (1, 1, 12),
        (1, 9, 1),
        (2, 1, 6),
        (1, 2, 2),
        (1, 2, 9),
        (2, 10, 16),
        (1, 20, 32),
        (3, 3, 3),
    ],
)
def test_every_lattice_shows(renderer, make, shape):
    empty = renderer.draw(make(positions=np.full((1, 1, 1, 3), 1e3)))
    frame = renderer.draw(make(positions=lattice(*shape), target=lattice(*shape) + np.array([0, 0.3, 0]), wind=[0, 0, 0]))
    assert np.any(frame != empty)


@pytest.mark.parametrize("scale", [0.0, 1e3, 1e300, -1e300])
def test_collapsed_and_diverged_flags_do_not_crash(renderer, make, scale):
    positions = scale * lattice()
    renderer.draw(make(positions=positions, target=positions, mast=scale * np.ones((2, 3)), wind=[1e-300, 0, 0]))


@pytest.mark.parametrize("wind", [[5, 0, 0], [-5, 0, 0], [0, 5, 0], [0, -5, 0], [0, 0, 5], [0, 0, -5], [1e6, 1, 1]])
def test_every_wind_draws(renderer, make, wind):
    assert np.any(renderer.draw(make(wind=wind)) != renderer.draw(make(wind=[0, 0, 0])))


def _color_at(renderer, snapshot, point):
    pixels, _ = Camera.framing(snapshot.bounds, renderer.width, renderer.height).project(np.array(point))
    frame = renderer.draw(snapshot)
    return frame[int(renderer.height - pixels[1]), int(pixels[0])].astype(int)


def test_nearer_cloth_hides_farther_cloth(make):
    renderer = Renderer(320, 320)
    forward = Camera.framing(BOUNDS, 320, 320).rotation[2]
    # Two sheets on one line of sight; the second is lower, so that another colour meets the spot.
    sheet, spot = lattice(wave=0.0), np.array([1.0, 0.0, 0.25])
    lower = sheet - [0.0, 0.0, 0.5]
    upper_alone = _color_at(renderer, make(positions=sheet), spot)
    lower_alone = _color_at(renderer, make(positions=lower), spot)
    assert np.abs(upper_alone - lower_alone).max() > 60
    for shift, expected in ((0.3, upper_alone), (-0.3, lower_alone)):
        seen = _color_at(renderer, make(positions=np.concatenate([sheet, lower + shift * forward])), spot)
        assert np.abs(seen - expected).max() <= 20, shift


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_cloth_and_pole_hide_each_other_by_depth(make, side):
    renderer = Renderer(320, 320)
    camera = Camera.framing(BOUNDS, 320, 320)
    # A sheet parallel to the picture, half a metre before or behind the pole.
    across = camera.rotation[0]
    row, col = np.meshgrid(np.linspace(-0.5, 0.5, 6), np.linspace(-0.5, 0.5, 6), indexing="ij")
    middle = np.array([0.0, 0.0, 0.5]) + 0.25 * across + 0.5 * side * camera.rotation[2]
    sheet = (middle + col[..., None] * across + row[..., None] * np.array([0, 0, 1.0]))[None]
    seen = _color_at(renderer, make(positions=sheet), [0.0, 0.0, 0.25])
    grey = np.ptp(seen) < 40
    assert grey == (side > 0.0), seen


def test_close_twice_and_then_refuse(make):
    renderer = Renderer(64, 64)
    renderer.draw(make())
    renderer.close()
    renderer.close()
    with pytest.raises(ValueError, match="closed"):
        renderer.draw(make())


@pytest.mark.parametrize(("width", "height"), [(0, 100), (63, 480), (480, 63), (100.5, 480), (480, 10**6), (True, 480)])
def test_refuses_sizes(width, height):
    with pytest.raises(ValueError, match=r"width|height"):
        Renderer(width, height)


@pytest.mark.parametrize("size", [(64, 64), (65, 200), (481, 479)])
def test_odd_sizes(make, size):
    frame = Renderer(*size).draw(make(wind=[1, 0, 0], distance=0.1, tolerance=0.05, target=lattice()))
    assert frame.shape == (size[1], size[0], 3)


def test_imports_are_lazy_and_pyplot_stays_out(run_python):
    run_python(
        """
import sys
import flag_env
before = set(sys.modules)
import tracemalloc

import numpy as np
from flag_env.render import Renderer, Snapshot
new = set(sys.modules) - before
assert not {"matplotlib", "PIL", "gymnasium", "numba", "flag_env.physics"} & new, new
box = np.array([[-1.0, -1, -1], [1, 1, 1]])
Renderer(64, 64).draw(Snapshot(np.random.default_rng(0).normal(size=(1, 4, 4, 3)), box, box))
assert "matplotlib.pyplot" not in sys.modules
"""
    )


def test_a_large_backdrop_takes_little_more_memory_than_itself():
    """Pictures of numbers for every pixel at once would take gigabytes at 8192 x 8192."""
    camera = Camera.framing(BOUNDS, 1536, 1536)
    tracemalloc.start()
    try:
        painted = backdrop(camera, BOUNDS, 1536, 1536)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < painted.nbytes + 32e6
