"""Checks the reference solutions against closed forms, and their forces against the slope of the energy."""

import math

import numpy as np
import pytest
import scipy.linalg

from flag_env.physics import Lattice, Scene, presets
from flag_env.physics.effects import AirDrag, AirPressure, Bending, CosineWind, CrossLayer, Gravity, Shear, Structural
from flag_env.studies import reference


def test_a_free_particle_in_wind_and_drag():
    c, g, m = 1.7, 9.81, 0.3
    mean, a, f, p = np.array([[0.2, 0.0, -0.1], [0.5, -0.3, 0.4], [3.0, 5.0, 0.0], [0.4, 0.0, 1.2]])
    scene = Scene(Lattice(1, 1, 1, mass=m, pinned="none"), (Gravity(g), AirDrag(c), CosineWind(a, f, mean, p)))
    times = np.array([0.3, 0.9, 2.0])
    found = reference.solve(scene, times, velocities=np.full((1, 1, 1, 3), 0.7))

    # v' = q + b cos(p + f t) - c v, solved by the steady swing, the drift and the decay of the rest
    q, b = mean / m - [0.0, 0.0, g], a / m
    response = b / (c + 1j * f)

    def steady(t):
        return q / c + (response * np.exp(1j * (p + f * t))).real

    v = steady(times[:, None]) + (0.7 - steady(0.0)) * np.exp(-c * times)[:, None]
    np.testing.assert_allclose(found.velocities[:, 0, 0, 0], v, rtol=0, atol=1e-10)
    swing = np.where(f > 0, 0.0, (response * np.exp(1j * p)).real) * times[:, None]
    whole = response / (1j * np.where(f > 0, f, 1.0))
    swing += np.where(f > 0, (whole * (np.exp(1j * (p + f * times[:, None])) - np.exp(1j * p))).real, 0.0)
    x = q / c * times[:, None] + swing + (0.7 - steady(0.0)) * (1 - np.exp(-c * times))[:, None] / c
    np.testing.assert_allclose(found.positions[:, 0, 0, 0], x, rtol=0, atol=1e-10)


@pytest.mark.parametrize("damping", ["isotropic", "axial"])  # one along a rope
def test_a_rope_follows_its_matrix_exponential(damping):
    k, z, m, n = 80.0, 0.9, 0.5, 5
    lattice = Lattice(1, 1, n + 2, 1.0, m, pinned="ends", dimensions=1)
    scene = Scene(lattice, (Structural(k, z, damping), AirDrag(0.2)))
    start = np.zeros((1, 1, n + 2, 3))
    start[0, 0, 1:-1, 2] = np.random.default_rng(0).standard_normal(n)
    found = reference.solve(scene, [0.5, 3.0], lattice.rest_positions + start, -2 * start)
    laplacian = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-k / m * laplacian, -z / m * laplacian - 0.2 * np.eye(n)]])
    for t, x, v in zip(*found, strict=True):
        expected = scipy.linalg.expm(t * matrix) @ np.concatenate([start[0, 0, 1:-1, 2], -2 * start[0, 0, 1:-1, 2]])
        np.testing.assert_allclose(np.concatenate([x[0, 0, 1:-1, 2], v[0, 0, 1:-1, 2]]), expected, rtol=0, atol=1e-9)
    assert not (found.positions - lattice.rest_positions)[..., :2].any()


def test_an_axial_damper_slows_the_stretching_and_not_the_turning():
    k, z, m, apart = 40.0, 0.6, 0.2, 0.5
    scene = Scene(Lattice(1, 1, 2, apart, m, pinned="none"), (Structural(k, z, "axial"),))
    along = np.array([[[[-0.1, 0, 0], [0.1, 0, 0]]]])
    found = reference.solve(scene, [0.7], velocities=along)
    rate, w = z / m, math.sqrt(2 * k / m - (z / m) ** 2)
    stretch = 0.2 / w * math.exp(-rate * 0.7) * math.sin(w * 0.7)
    length = np.linalg.norm(np.diff(found.positions[0, 0, 0], axis=0))
    assert length == pytest.approx(apart + stretch, abs=1e-11)
    turning = along + np.array([[[[0, 0.3, 0.2], [0, -0.3, -0.2]]]])
    found = reference.solve(scene, [0.7], velocities=turning)
    spin = [
        np.cross(x, v).sum(axis=(0, 1, 2))
        for x, v in ((scene.lattice.rest_positions, turning), (found.positions[0], found.velocities[0]))
    ]
    np.testing.assert_allclose(spin[1], spin[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("tapered", [True, False])
def test_forces_are_the_slope_of_the_energy(tapered):
    """Of every kind of link at once; the effects' energies are written by families of links, the reference by single ones."""
    random = np.random.default_rng(0)
    lattice = Lattice(2, 3, 4, (0.1, 0.12, 0.07), 0.02, 0.3)
    links = (kind(k, tapered=tapered) for kind, k in ((Structural, 12.0), (Shear, 5.0), (Bending, 3.0), (CrossLayer, 7.0)))
    scene = Scene(lattice, (Gravity(tapered=tapered), *(link.scaled(1.0, 0.0) for link in links)))
    x = lattice.rest_positions.reshape(-1, 3) + 0.02 * random.standard_normal((lattice.size, 3))
    slope = reference.right_hand_side(scene)(0.0, np.stack([x, np.zeros_like(x)]).ravel()).reshape(2, -1, 3)[1]
    force = lattice.masses[:, None] * slope
    assert not force[lattice.fixed].any()
    for particle, axis in ((1, 0), (7, 1), (14, 2), (23, 0), (18, 1)):
        sides = []
        for change in (1e-5, -1e-5):
            moved = x.copy()
            moved[particle, axis] += change
            sides.append(sum(effect.energy(lattice, moved[None])[0] for effect in scene.effects))
        assert force[particle, axis] == pytest.approx((sides[1] - sides[0]) / 2e-5, rel=1e-6, abs=1e-7)


def test_pinned_particles_go_on_evenly_and_the_start_is_the_simulators():
    scene = presets.flag(3, 4)
    speed = np.zeros((1, 3, 4, 3))
    speed[:, :, 0] = 0.1, -0.2, 0.3
    found = reference.solve(scene, [0.02, 0.05], velocities=speed, rtol=1e-6)
    for t, x in zip(found.times, found.positions, strict=True):
        np.testing.assert_allclose(x[:, :, 0], scene.lattice.rest_positions[:, :, 0] + t * speed[:, :, 0], atol=1e-12)
    assert np.abs(found.positions[..., 1:, 1]).max() > 1e-5  # it starts off its plane


def test_what_it_does_not_know_is_refused():
    with pytest.raises(ValueError, match=r"effects must be among Gravity, .* got AirPressure"):
        reference.right_hand_side(presets.flag(3, 4).adding(AirPressure()))
    with pytest.raises(ValueError, match="times must rise"):
        reference.solve(presets.flag(3, 4), [0.1, 0.1])
    with pytest.raises(ValueError, match="positions must have the shape"):
        reference.solve(presets.flag(3, 4), [0.1], positions=np.zeros((3, 4, 3)))
