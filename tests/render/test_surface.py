"""The drawn surface against the lattice it interpolates."""

from __future__ import annotations

import numpy as np
import pytest
from render_flags import lattice

from flag_env.render.shading import SUN, cloth_light, shade_cells
from flag_env.render.surface import MOST_CELLS, cells_of, surface_for


@pytest.mark.parametrize("shape", [(1, 2, 2), (1, 10, 16), (2, 5, 3), (1, 200, 300)])
def test_a_plane_stays_the_plane_and_corners_stay(shape):
    flat = lattice(*shape, wave=0.0)
    grid = surface_for(*shape).vertices(flat)
    assert grid.shape[0] == shape[0]
    for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        np.testing.assert_allclose(grid[:, *corner], flat[:, *corner], atol=1e-13)
    step = np.diff(grid[..., 0], axis=2)
    assert step.min() > 0.0
    np.testing.assert_allclose(grid[..., 0], np.broadcast_to(grid[:1, :1, :, 0], grid.shape[:3]), atol=1e-13)
    np.testing.assert_allclose(grid[..., 2], np.broadcast_to(grid[:, :, :1, 2], grid.shape[:3]), atol=1e-13)


def test_goes_through_the_particles_and_is_capped():
    shape = (1, 3, 6)
    positions = np.random.default_rng(0).normal(size=(*shape, 3))
    grid = surface_for(*shape).vertices(positions)
    # Every particle is found where the drawn grid has a vertex at its place.
    along = grid.shape[2] - 1
    for col in range(6):
        at = col * along / 5
        if at == int(at):
            np.testing.assert_allclose(grid[0, 0, int(at)], positions[0, 0, col], atol=1e-12)
    assert len(surface_for(1, 300, 300).albedo[0]) <= 1.1 * MOST_CELLS


@pytest.mark.parametrize("shape", [(1, 2, 2), (1, 10, 16), (2, 5, 3)])
def test_where_it_is_torn_a_cell_depends_on_its_corners_alone(shape):
    layers, rows, cols = shape
    surface = surface_for(*shape, torn=True)
    positions = lattice(*shape)
    intact = np.random.default_rng(0).random((layers, rows - 1, cols - 1)) < 0.5
    corners = np.zeros(shape, bool)
    for down in (0, 1):
        for right in (0, 1):
            corners[:, down : rows - 1 + down, right : cols - 1 + right] |= intact
    moved = np.where(corners[..., None], positions, 1e6)
    drawn = surface.cells(intact).ravel()
    before, after = (cells_of(surface.vertices(x))[drawn] for x in (positions, moved))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-9)
    assert drawn.mean() == intact.mean()


def test_cells_count_and_order():
    grid = lattice(2, 3, 4)
    cells = cells_of(grid)
    assert cells.shape == (2 * 2 * 3, 4, 3)
    np.testing.assert_array_equal(cells[0], grid[0][[0, 0, 1, 1], [0, 1, 1, 0]])


def test_shade_follows_the_angle_to_the_sun_and_both_sides_are_lit():
    def shade(normal):
        first = np.cross(normal, [0.3, 0.2, 0.9])
        light = cloth_light(first, np.cross(normal, first), np.array([0.0, 1, 0]))
        square = np.array([[[0.0, 0], [1, 0], [1, 1], [0, 1]]])
        return shade_cells(np.broadcast_to(light, (1, 4, 2, 4)), square, np.full((2, 1, 3), 0.5))

    facing, oblique, away = shade(SUN), shade(np.array([0.6, -0.8, 0.0])), shade(-SUN)
    assert facing.shape == (1, 4, 3)
    assert np.all(facing > oblique)
    assert np.all(oblique > away)
    assert np.all(away > 0.1)


@pytest.mark.parametrize(("rows", "cols"), [(20, 32), (10, 16)])
def test_light_is_that_of_a_cylinders_own_normals(rows, cols):
    """A sheet bent round an upright cylinder: the light at every drawn vertex against the closed form."""
    surface = surface_for(1, rows, cols)
    turn, height = np.meshgrid(np.linspace(0.0, 2.0, cols), np.linspace(0.0, 1.0, rows))
    bent = np.stack([np.sin(turn), -np.cos(turn), height], axis=-1)[None]
    vertices, forward = surface.vertices(bent), np.array([0.0, 1.0, 0.0])
    light = surface.light(bent, vertices, forward)[:, 0]
    corner = vertices[:, :-1, :-1].reshape(-1, 3)
    radial = corner[:, :2] / np.linalg.norm(corner[:, :2], axis=1, keepdims=True)
    along = np.stack([-radial[:, 1], radial[:, 0], np.zeros(len(radial))])
    expected = cloth_light(along, np.broadcast_to([[0.0], [0.0], [1.0]], along.shape), forward)
    inner = (corner[:, 0] > np.sin(2.0 / (cols - 1))) & (np.arctan2(corner[:, 0], -corner[:, 1]) < 2.0 - 2.0 / (cols - 1))
    assert np.abs(light - expected)[inner].max() < 0.004


def test_borders_of_the_pattern_are_borders_of_cells():
    surface = surface_for(1, 20, 32)
    u, v = (surface.vertices(lattice(1, 20, 32, wave=0.0))[0, ..., axis] for axis in (0, 2))
    for place in (0.5 - 0.085, 0.5 + 0.085):
        assert np.abs(v[:, 0] - place).min() < 1e-12
    for place in (0.035, 0.38 - 0.17 / 3, 0.38 + 0.17 / 3):
        assert np.abs(u[0] - 1.5 * place).min() < 1e-12
