"""Tearing: where and when links break, and what goes on as before."""

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, Shear, StrainLimit, Structural, Tearing

LINKS = Structural(50.0, 0.01), Shear(20.0, 0.01), Bending(5.0, 0.01)
STORM = CosineWind((0.02, 0.03, 0.01), (3.0, 7.0, 5.0), (0.02, 0.005, 0.0))
NAMES = {Structural: "structural", Shear: "shear", Bending: "bending", CrossLayer: "cross_layer"}


def weights(sim):
    """Link weights of every copy by the name of their effect; zero where broken."""
    kinds = [type(effect) for effect in sim.scene.effects]
    names = [NAMES[kind] for kind in kinds if kind in NAMES]
    return dict(zip(names, sim.get_state().effects[kinds.index(Tearing)], strict=True))


def held(sim):
    """Number of links that hold, by copy."""
    return sum((weight != 0).sum(axis=(1, 2)) for weight in weights(sim).values())


def chain(cols, *effects, pinned="edge", dimensions=3, **fields):
    return Scene(Lattice(1, 1, cols, 0.1, 0.01, pinned=pinned, dimensions=dimensions), effects, **fields)


def cloth(*effects, pinned="edge", dtype="float64", layers=1):
    links = LINKS if layers == 1 else (LINKS[0], LINKS[2], CrossLayer(20.0, 0.01))
    return Scene(Lattice(layers, 6, 8, 0.1, 0.004, 0.5, pinned), (Gravity(), *links, *effects), dtype=dtype)


def stormy(dtype="float64", *more):
    return cloth(AirDrag(1.0), STORM, *more, Tearing(0.25), dtype=dtype)


# -- where links break -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_loaded_chain_breaks_at_its_top_and_the_rest_falls_freely(dtype):
    """Strain of link i is (weight below it) / (k l): the first link bears most. What falls does so at g exactly."""
    lattice = Lattice(1, 10, 1, 0.1, 0.01, pinned=(9,))
    load = 9 * 0.01 * 9.81 / (20.0 * 0.1)
    scene = Scene(lattice, (Gravity(), Structural(20.0, 0.2), Tearing(0.98 * load)), dtype=dtype)
    sim = Simulator(scene)
    pose = sim.positions[0]
    strain = np.array([t * 0.01 * 9.81 / (20.0 * 0.1) for t in range(1, 10)])  # upwards from the free end
    pose[0, :, 0, 2] = np.concatenate([[0], np.cumsum(0.1 * (1 + strain))])
    pose[0, 1:-1, 0, 2] -= 1e-5  # as good as hanging still
    sim.set_positions(pose)
    sim.step(1)
    whole = weights(sim)["structural"][0, 0]
    np.testing.assert_array_equal(np.flatnonzero(whole == 0), [8, 9])  # the top one; none starts at the last particle
    v = sim.velocities[0, 0, :-1, 0, 2].mean()
    x = sim.positions[0, 0, :-1, 0, 2].mean()
    t0 = sim.time
    sim.advance(0.2)
    t = sim.time - t0
    # the centre of mass; the scheme's own parabola has h g t / 2 besides
    expected = x + v * t - 0.5 * 9.81 * t**2
    assert sim.positions[0, 0, :-1, 0, 2].mean() == pytest.approx(expected, abs=9.81 * sim.timestep * t + 1e-5)
    assert sim.velocities[0, 0, :-1, 0, 2].mean() == pytest.approx(v - 9.81 * t, abs=1e-4)
    np.testing.assert_array_equal(sim.positions[0, 0, -1], pose[0, -1].astype(dtype))


@pytest.mark.parametrize("kind", [Structural, Shear, Bending, CrossLayer])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_exactly_the_links_beyond_the_strain_break(kind, dtype):
    lattice = Lattice(2, 3, 4, (0.1, 0.2, 0.3), pinned="none")
    sim = Simulator(Scene(lattice, (kind(0.0, 0.0), Tearing(0.3)), timestep=1e-3, dtype=dtype), copies=2)
    name = NAMES[kind]
    pose = sim.positions + 0.05 * np.random.default_rng(0).standard_normal((2, *lattice.shape, 3))
    sim.set_positions(pose)
    expected = np.zeros_like(weights(sim)[name], bool)
    for j, family in enumerate(kind().families(lattice)):
        for copy, t in np.ndindex(2, len(family.present)):
            ends = pose[copy].reshape(-1, 3)[[t, t + family.offset]]
            expected[copy, j, t] = family.present[t] and np.linalg.norm(ends[1] - ends[0]) / family.length - 1 <= 0.3
    assert expected.any()
    assert expected.sum() < (weights(sim)[name] != 0).sum()
    sim.step(1)
    np.testing.assert_array_equal(weights(sim)[name] != 0, expected)


def test_a_rope_breaks_by_its_slant():
    for strain, breaks in ((0.299, False), (0.301, True)):
        sim = Simulator(chain(3, Structural(0.0, 0.0), Tearing(0.3), dimensions=1, timestep=1e-3))
        pose = sim.positions[0]
        pose[0, 0, 2, 2] = 0.1 * np.sqrt((1 + strain) ** 2 - 1)
        sim.set_positions(pose)
        sim.step(1)
        assert held(sim) == 2 - breaks


def test_shear_and_bending_go_with_the_cloth_they_stand_for():
    """Cut between columns 2 and 3, whose ends move apart by less than would break anything but the structural links."""
    lattice = Lattice(1, 5, 6, 0.1, pinned="none")
    sim = Simulator(Scene(lattice, (Structural(0.0), Shear(0.0), Bending(0.0), Tearing(0.2)), timestep=1e-6))
    pose = sim.positions[0]
    pose[..., 3:, 0] += 0.022  # 22 % of a structural link, 12 % of a diagonal, 11 % of a bending link
    sim.set_positions(pose)
    whole = {name: weight.copy() for name, weight in weights(sim).items()}
    sim.step(1)
    across = {"structural": [(0, 2)], "shear": [(0, 2), (1, 3)], "bending": [(0, 1), (0, 2)]}
    for name, families in across.items():
        expected = whole[name].reshape(1, -1, 5, 6)
        for family, col in families:
            expected[0, family, :, col] = 0
        np.testing.assert_array_equal(weights(sim)[name], whole[name], err_msg=name)


def test_a_cell_keeps_its_diagonals_while_one_way_round_is_left():
    lattice = Lattice(1, 2, 2, 0.1, pinned="none")
    sim = Simulator(Scene(lattice, (Structural(0.0), Shear(0.0), Tearing(0.2)), timestep=1e-6))
    pose = sim.positions[0]
    pose[0, 0, 0] += [-0.021, 0.0, 0.0]  # the lower edge alone
    sim.set_positions(pose)
    sim.step(1)
    assert (weights(sim)["structural"] != 0).sum() == 3
    assert (weights(sim)["shear"] != 0).sum() == 2
    pose[0, 0, 0] += [0.0, 0.0, -0.021]  # its left edge too: that corner hangs by nothing but a diagonal
    sim.set_positions(pose)
    sim.step(1)
    np.testing.assert_array_equal(weights(sim)["shear"][0] != 0, [[False] * 4, [False, True, False, False]])


# -- what tearing must not change --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_below_the_strain_nothing_changes(dtype):
    scene = stormy(dtype).adding(Tearing(5.0))
    sims = [Simulator(given, copies=2) for given in (scene.without(Tearing), scene)]
    for sim in sims:
        sim.step(300)
    np.testing.assert_array_equal(sims[0].positions, sims[1].positions)
    np.testing.assert_array_equal(sims[0].velocities, sims[1].velocities)
    assert sims[0].energy().keys() == sims[1].energy().keys()
    for name, energy in sims[0].energy().items():
        np.testing.assert_array_equal(energy, sims[1].energy()[name])
    assert sims[0].timestep == sims[1].timestep


def test_scenes_without_tearing_share_their_weights_among_copies():
    sim = Simulator(presets.flag(4, 5).adding(StrainLimit()), copies=3)
    assert {data.weight.shape[0] for data in sim.run.effects if hasattr(data, "offset")} == {1}


def test_a_broken_link_exerts_no_force_whatever_becomes_of_it():
    sim = Simulator(chain(3, Structural(20.0, 0.1), Tearing(0.2), pinned="none", timestep=1e-3))
    pose = sim.positions[0]
    pose[..., 2, 0] += 0.05
    sim.set_positions(pose)
    sim.step(1)
    assert held(sim) == 1
    assert sim.energy()["structural"] == pytest.approx(0.0, abs=1e-6)  # what one step has moved
    sim.set_positions(np.array(sim.scene.lattice.rest_positions))
    sim.set_velocities([[[[0.0, 0, 0], [0.0, 0, 0], [1.0, 2.0, 3.0]]]])
    sim.step(100)
    np.testing.assert_allclose(sim.positions[0, 0, 0, 2], [0.3, 0.2, 0.3], atol=1e-12)
    np.testing.assert_array_equal(sim.positions[0, 0, 0, :2], sim.scene.lattice.rest_positions[0, 0, :2])
    assert held(sim) == 1


def test_energy_leaves_out_what_is_broken():
    """After a tear the energy of the links is that of the links that hold, one by one."""
    sim = Simulator(stormy(), copies=2)
    sim.set_wind(mean=[[0.0, 0.0, 0.0], [0.2, 0.1, 0.0]])
    sim.advance(0.5)
    assert held(sim)[1] < held(sim)[0]
    lattice = sim.scene.lattice
    for copy in range(2):
        x = sim.positions[copy].reshape(-1, 3)
        for effect in LINKS:
            name = type(effect).__name__.lower()
            total = 0.0
            for weight, family in zip(weights(sim)[name][copy], effect.families(lattice), strict=True):
                for t in np.flatnonzero(weight):
                    stretch = np.linalg.norm(x[t + family.offset] - x[t]) - family.length
                    total += 0.5 * effect.stiffness * stretch**2
            assert sim.energy()[name][copy] == pytest.approx(total, rel=1e-12)


# -- with a limit of strain --------------------------------------------------------------------------------------------------


def test_a_strain_limit_lets_go_of_broken_links():
    """The outer half of a chain, cut by hand's pull, falls freely though the limit held it before."""
    effects = Gravity(), Structural(20.0, 0.1), Tearing(0.4), StrainLimit(0.3)
    sim = Simulator(chain(6, *effects, timestep=1e-3), copies=2)
    pose = np.array(sim.positions)
    pose[0, ..., 3:, 0] += 0.05  # more than tearing allows, in the first copy
    sim.set_positions(pose)
    sim.step(1)
    np.testing.assert_array_equal(held(sim), [4, 5])
    v, x = sim.velocities[0, 0, 0, 3:].mean(axis=0), sim.positions[0, 0, 0, 3:].mean(axis=0)
    sim.step(600)
    t = 0.6
    expected = x + v * t - [0, 0, 0.5 * 9.81 * t**2]
    np.testing.assert_allclose(sim.positions[0, 0, 0, 3:].mean(axis=0), expected, atol=9.81 * 1e-3 * t)
    lengths = np.linalg.norm(np.diff(sim.positions[:, 0, 0], axis=1), axis=-1)
    assert lengths[0, 2] > 1.0
    assert np.delete(lengths[0], 2).max() < 0.13 * 1.001
    assert lengths[1].max() < 0.13 * 1.001


def test_a_limit_below_the_strain_keeps_links_whole():
    calm, wild = (stormy("float64", *more) for more in ((StrainLimit(0.1),), ()))
    links = []
    for scene in (calm, wild):
        sim = Simulator(scene)
        sim.set_wind(mean=(0.1, 0.05, 0.0))
        sim.step(800)
        assert np.isfinite(sim.positions).all()
        links.append((weights(sim)["structural"] != 0).sum())
    assert links[0] == 6 * 7 + 5 * 8
    assert links[1] < links[0]


@pytest.mark.parametrize("wrong", [0.0, -0.1, np.nan, -np.inf])
def test_wrong_arguments_are_refused(wrong):
    with pytest.raises(ValueError, match="strain"):
        Tearing(wrong)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 3), (1, 3, 1), (2, 2, 2), (1, 2, 2)])
def test_small_lattices(shape):
    scene = Scene(Lattice(*shape, 0.1, 0.01, 0.5), (Gravity(), *LINKS, CrossLayer(5.0), Tearing(0.1)), timestep=1e-3)
    sim = Simulator(scene, copies=2)
    sim.set_velocities(np.random.default_rng(0).normal(0, 3, (*shape, 3)))
    sim.step(200)
    assert np.isfinite(sim.positions).all()
