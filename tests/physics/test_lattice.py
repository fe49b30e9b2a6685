"""Checks lattices, link families, scenes and presets against enumeration by brute force."""

import pickle
from itertools import product

import numpy as np
import pytest

from flag_env.physics import Lattice, integrators, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, Shear, Structural

SHAPES = [(1, 1, 1), (1, 1, 6), (1, 6, 1), (1, 2, 2), (1, 3, 2), (1, 3, 3), (1, 4, 5), (2, 1, 1), (2, 2, 2), (2, 3, 4), (3, 2, 3)]
STEPS = {
    Structural: {(0, 0, 1), (0, 1, 0)},
    Shear: {(0, 1, 1), (0, 1, -1)},
    Bending: {(0, 0, 2), (0, 2, 0)},
    CrossLayer: {(1, 0, 0), (1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)},
}


def particles(shape):
    return list(product(*map(range, shape)))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("kind", STEPS, ids=lambda kind: kind.__name__)
def test_families_hold_every_link_once(kind, shape):
    lattice = Lattice(*shape, spacing=(0.1, 0.2, 0.3), taper=0.4)
    number = {p: i for i, p in enumerate(particles(shape))}
    expected = {}
    for p, step in product(number, STEPS[kind]):
        q = tuple(np.add(p, step))
        if q in number:
            length = np.sqrt((0.3 * step[0]) ** 2 + (0.2 * step[1]) ** 2 + (0.1 * step[2]) ** 2)
            share = [1 - 0.6 * col / max(shape[2] - 1, 1) for _, _, col in (p, q)]
            expected[number[p], number[q]] = (length, sum(share) / 2)
    found = {}
    for family in lattice.families(*kind.directions):
        assert len(family.present) == len(family.taper) == lattice.size - family.offset
        for t in np.flatnonzero(family.present):
            link = (int(t), int(t) + family.offset)
            assert link not in found
            found[link] = (family.length, family.taper[t])
        np.testing.assert_array_equal(family.weight(False), family.present)
        np.testing.assert_array_equal(family.weight(True), np.where(family.present, family.taper, 0.0))
    assert found.keys() == expected.keys()
    for link, values in expected.items():
        assert found[link] == pytest.approx(values, rel=1e-14)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_masses_and_rest_positions(shape):
    lattice = Lattice(*shape, spacing=(0.1, 0.2), mass=0.5, taper=0.1)
    assert lattice.shape == shape
    assert lattice.size == len(particles(shape))
    for i, (layer, row, col) in enumerate(particles(shape)):
        share = 1 - 0.9 * col / (shape[2] - 1) if shape[2] > 1 else 1.0
        assert lattice.masses[i] == pytest.approx(0.5 * share, rel=1e-15)
        np.testing.assert_allclose(lattice.rest_positions[layer, row, col], [0.1 * col, 0.1 * layer, 0.2 * row], rtol=1e-15)


@pytest.mark.parametrize(
    ("pinned", "columns"), [("edge", {0}), ("sleeve", {0, 1}), ("ends", {0, 4}), ("none", set()), ((7, 2, 7), None), ((), None)]
)
def test_pinned_particles(pinned, columns):
    lattice = Lattice(2, 3, 5, pinned=pinned)
    numbers = {i for i, p in enumerate(particles((2, 3, 5))) if columns is not None and p[2] in columns} or set(
        pinned if columns is None else ()
    )
    assert set(np.flatnonzero(lattice.fixed)) == numbers


def test_a_lattice_is_a_value():
    lattice = Lattice(1, 3, 4, spacing=[0.1, 0.2], pinned=np.array([3, 1]))
    assert lattice == Lattice(1, 3, 4, spacing=(0.1, 0.2), pinned=(1, 3))
    assert hash(lattice) == hash(Lattice(1, 3, 4, spacing=(0.1, 0.2), pinned=(1, 3)))
    assert lattice != Lattice(1, 3, 4, spacing=(0.1, 0.3), pinned=(1, 3))
    assert pickle.loads(pickle.dumps(lattice)) == lattice
    with pytest.raises(AttributeError):
        lattice.rows = 5
    with pytest.raises(ValueError, match="read-only"):
        lattice.rest_positions[0] = 1.0
    assert lattice.extent == pytest.approx((0.3, 0.4))
    assert lattice.diagonal == pytest.approx(0.5)


def test_a_scene_is_a_value_and_its_methods_give_new_ones():
    scene = presets.flag(4, 5)
    copy = pickle.loads(pickle.dumps(scene))
    assert copy == scene
    assert hash(copy) == hash(scene)
    with pytest.raises(AttributeError):
        scene.timestep = 1.0

    def kinds(scene):
        return [type(effect) for effect in scene.effects]

    assert scene.replace(timestep=1e-4).timestep == 1e-4
    assert scene.replace(integrator=integrators.Leapfrog(), dtype=np.float32).dtype == "float32"
    assert kinds(scene.without(Shear, AirDrag)) == [Gravity, Structural, Bending, CosineWind]
    assert kinds(scene.without(CrossLayer)) == kinds(scene)
    added = scene.adding(CrossLayer(3.0), Gravity(1.0))
    assert kinds(added) == [*kinds(scene), CrossLayer]
    assert added.effects[0] == Gravity(1.0)
    scaled = scene.scaled(stiffness=2.0, viscosity=0.5)
    for before, after in zip(scene.effects, scaled.effects, strict=True):
        if isinstance(before, (Structural, Shear, Bending)):
            assert after == type(before)(2 * before.stiffness, 0.5 * before.viscosity, before.damping, before.tapered)
        else:
            assert after == before
    assert scene == copy == presets.flag(4, 5)


@pytest.mark.parametrize(("rows", "cols"), [(2, 2), (5, 9), (20, 32), (31, 17)])
def test_flag_keeps_size_and_mass_however_fine(rows, cols):
    lattice = presets.flag(rows, cols, length=1.5, height=0.8, density=0.2, taper=0.3).lattice
    assert lattice.masses.sum() == pytest.approx(0.2 * 1.5 * 0.8, rel=1e-13)
    assert lattice.masses[cols - 1] / lattice.masses[0] == pytest.approx(0.3)
    np.testing.assert_allclose(np.ptp(lattice.rest_positions, axis=(0, 1, 2)), [1.5, 0.0, 0.8], rtol=1e-13)


def test_report_flag_has_the_reports_units():
    for layers, cross in ((1, Shear), (2, CrossLayer)):
        scene = presets.report_flag(layers)
        assert scene.lattice.shape == (layers, 10, 15)
        assert scene.lattice.masses[14] == pytest.approx(0.1)
        assert cross(1e5, 10.0, tapered=True) in scene.effects
        assert scene.timestep == 1e-3
