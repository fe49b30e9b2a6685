"""Colours, texture and point of view as arguments: seen where they should be, or refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from render_flags import BOUNDS, lattice

from flag_env.render import Palette, Renderer, Style
from flag_env.render.camera import Camera

FLAT = lattice(wave=0.0)


def color_at(style, make, row, col):
    """What is seen at a particle of a flat flag."""
    renderer = Renderer(320, 320, style)
    camera = Camera.framing(BOUNDS, 320, 320, style.azimuth, style.elevation)
    x, y = camera.project(FLAT[0, row, col])[0]
    return renderer.draw(make(positions=FLAT))[320 - int(y), int(x)].astype(float)


def test_a_texture_lies_with_its_first_row_on_top_and_its_left_edge_at_the_mast(make):
    texture = np.zeros((2, 3, 3))
    texture[0, 0], texture[0, 2], texture[1, 0], texture[1, 2] = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)
    style = Style(texture=texture)
    top_left, top_right, low_left, low_right = (color_at(style, make, row, col) for row in (8, 1) for col in (2, 13))
    assert top_left.argmax() == 0
    assert top_right.argmax() == 1
    assert low_left.argmax() == 2
    assert np.ptp(low_right) < 60 < low_right.min()
    np.testing.assert_array_equal(color_at(Style(texture=(255 * texture).astype(np.uint8)), make, 8, 2), top_left)


def test_a_palette_colours_the_fields(make):
    blue = Style(Palette((0.1, 0.1, 0.9), (0.1, 0.9, 0.1), (1.0, 1.0, 1.0), (0.5, 0.5, 0.5)))
    assert color_at(blue, make, 8, 3).argmax() == 2
    assert color_at(blue, make, 8, 12).argmax() == 1


def test_from_behind_the_flag_is_seen_the_other_way_round():
    front, back = (Camera.framing(BOUNDS, 320, 320, azimuth).project(FLAT[0, 5])[0][:, 0] for azimuth in (-62.0, 118.0))
    assert (np.diff(front) > 0).all()
    assert (np.diff(back) < 0).all()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"palette": ((1, 0, 0),)}, "palette is"),
        ({"palette": ((2, 0, 0),) * 4}, "palette is"),
        ({"texture": np.zeros((4, 4))}, r"texture is of shape \(4, 4\)"),
        ({"texture": np.full((2, 2, 3), 200.0)}, "texture runs from 200 to 200"),
        ({"texture": np.full((2, 2, 3), np.nan)}, "texture runs from nan"),
        ({"azimuth": 1e6}, "azimuth is 1000000.0"),
        ({"elevation": 90}, "elevation is 90; allowed is a number of degrees from 0 to 80"),
        ({"elevation": True}, "elevation is True"),
    ],
)
def test_what_is_no_style_is_refused_by_name(arguments, match):
    with pytest.raises(ValueError, match=match):
        Style(**arguments)
