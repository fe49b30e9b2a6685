"""The projection against closed forms, and the framing of the view box."""

from __future__ import annotations

import numpy as np
import pytest
from render_flags import BOUNDS

from flag_env.render.camera import FAR_PIXELS, Camera


def test_pinhole_closed_form():
    # Looks along +y from (0, -4, 0): x is to the right, z is up, depth is y + 4.
    camera = Camera(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]]), np.array([0.0, -4, 0]), 100.0, np.array([50.0, 60]))
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 4, -2]])
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(depth, [4, 4, 4, 8], rtol=1e-15)
    np.testing.assert_allclose(pixels, [[50, 60], [75, 60], [50, 85], [62.5, 35]], rtol=1e-15)
    np.testing.assert_allclose(camera.scale(depth), [25, 25, 25, 12.5])


@pytest.mark.parametrize(("width", "height"), [(480, 480), (640, 360), (120, 300)])
def test_framing_is_a_rotation_that_fills_one_side(width, height):
    camera = Camera.framing(BOUNDS, width, height)
    np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-14)
    assert camera.rotation[1, 2] > 0.9  # z is up
    assert camera.rotation[0, 0] > 0.5  # x is to the right
    assert camera.rotation[2, 1] > 0.5  # from the front
    centre, half = BOUNDS.mean(axis=0), 0.5 * (BOUNDS[1] - BOUNDS[0])
    faces = centre + half * np.concatenate([np.eye(3), -np.eye(3)])
    pixels, depth = camera.project(faces)
    assert np.all(depth > 0.0)
    assert np.all(pixels > 0.0)
    assert np.all(pixels < [width, height])


def test_points_behind_and_far_away_stay_finite():
    camera = Camera.framing(BOUNDS, 100, 100)
    points = np.array([camera.eye, 2.0 * camera.eye, [1e12, -1e12, 1e12]])
    pixels, depth = camera.project(points)
    assert np.isfinite(pixels).all()
    assert np.abs(pixels).max() <= FAR_PIXELS
    assert np.all(depth > 0.0)
