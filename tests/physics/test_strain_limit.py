"""The strain limit holds, and agrees with closed forms."""

import warnings

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, presets
from flag_env.physics.effects import Bending, CosineWind, Gravity, Shear, StrainLimit, Structural
from flag_env.physics.effects.strain_limit import TOLERANCE

STRONG = CosineWind((0.02, 0.03, 0.01), (3.0, 7.0, 5.0), (0.02, 0.005, 0.0))
NOISE = {"float64": 1e-12, "float32": 1e-5}


def strains(positions, lattice):
    """Strain of every link between neighbours, along rows and up columns."""
    along, up, _ = lattice.spacings
    lengths = [np.linalg.norm(np.diff(positions, axis=axis), axis=-1) for axis in (-2, -3)]
    return np.concatenate([(length / rest - 1).ravel() for length, rest in zip(lengths, (along, up), strict=True)])


def largest(sim):
    return strains(sim.positions, sim.scene.lattice).max()


def most(stretch, dtype="float64"):
    """Largest strain that the limit promises."""
    return (1 + stretch) * (1 + TOLERANCE) - 1 + NOISE[dtype]


def chain(cols, effects=(), pinned="none", **lattice):
    return Scene(Lattice(1, 1, cols, 1.0, 1.0, pinned=pinned, **lattice), effects, timestep=1e-2)


def momentum(sim):
    return np.tensordot(sim.scene.lattice.masses, sim.get_state().velocities[0].T, 1)


# -- the limit holds ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "dtype"),
    [(presets.flag, "float64"), (presets.flag, "float32"), (presets.sheet, "float64"), (presets.two_layer_flag, "float32")],
)
@pytest.mark.parametrize(("stiffness", "stretch"), [(100.0, 0.1), (10.0, 0.1), (10.0, 0.0)])
def test_no_link_is_longer_in_strong_wind(make, stiffness, stretch, dtype):
    sim = Simulator(make(8, 12, stiffness=stiffness, dtype=dtype).adding(STRONG, StrainLimit(stretch)))
    rng = np.random.default_rng(0)
    place, seen = np.zeros(3), []
    for step in range(1200):
        if step % 20 == 0:
            place += rng.normal(0, 0.01, 3) * [1, make is not presets.sheet, 1]
            sim.set_mast(place)
            sim.set_wind(mean=rng.normal(0, 0.03, 3))
        sim.step(1)
        seen.append(largest(sim))
    assert max(seen) <= most(stretch, dtype)
    assert np.quantile(seen, 0.8) > 0.99 * stretch  # it had something to do


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("spread", [0.05, 0.5, 5.0])
def test_any_pose_is_brought_within_the_limit(spread, dtype):
    scene = presets.flag(8, 12, dtype=dtype).adding(StrainLimit(0.1))
    sim = Simulator(scene)
    pose = sim.positions[0]
    pose[:, :, 1:] = 1.3 * pose[:, :, 1:] + spread * np.random.default_rng(1).standard_normal(pose[:, :, 1:].shape)
    sim.set_positions(pose)
    for _ in range(50):
        sim.step(1)
        assert largest(sim) <= most(0.1, dtype)
    speed = np.linalg.norm(sim.velocities, axis=-1).max()
    assert speed < 30  # being shortened by hundreds of metres per second has left no speed; springs and folds have left some


@pytest.mark.parametrize("stiffness", [1.0, 10.0])
def test_a_soft_flag_sags_no_more_than_its_limit(stiffness):
    """Hung by its edge from the top: own weight stretches it many times over, the limit lets through half a percent."""
    lattice = Lattice(1, 16, 24, 0.05, 1e-3, pinned=tuple(15 * 24 + np.arange(24)))
    links = Structural(stiffness, 0.02), Shear(stiffness / 4, 0.02), Bending(stiffness / 50, 0.02)
    scene = Scene(lattice, (Gravity(), *links))
    sag = {}
    for name, given in (("springs", scene), ("limited", scene.adding(StrainLimit(0.005)))):
        sim = Simulator(given)
        assert sim.timestep == Simulator(scene).timestep
        sim.advance(3.0)
        height = sim.positions[0, 0, :, :, 2]
        sag[name] = ((height[-1] - height[0]).max()) / lattice.extent[1] - 1
    alone = 9.81 * 1e-3 * 15 * 16 / 2 / stiffness / lattice.extent[1]  # the weight below each link, one on another
    assert sag["springs"] > 0.5 * alone
    assert sag["limited"] < 0.01
    assert sag["limited"] < most(0.005)
    assert alone > 0.1


def test_what_the_mast_makes_impossible_is_finite_and_as_short_as_it_can_be():
    """Two ends half as far again apart: the mean strain is the pinned ends', shared out evenly among equal masses."""
    sim = Simulator(chain(16, (Gravity(), StrainLimit(0.1)), "ends"))
    pose = sim.positions[0]
    pose[..., 0] *= 1.5
    sim.set_positions(pose)
    with pytest.warns(RuntimeWarning, match="StrainLimit does not hold: 1 steps"):
        sim.step(1)
    for step in range(1, 100):  # and no second warning
        assert sim.strain_limit_misses[0] == step
        sim.step(1)
        assert 0.5 - 1e-9 <= largest(sim) < 0.56
    assert np.linalg.norm(sim.velocities, axis=-1).max() < 1
    assert np.abs(sim.positions[0, ..., 1:]).max() < 0.1


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize(("rows", "cols"), [(1, 24), (10, 16)])
def test_it_holds_between_two_fast_pins(rows, cols, dtype):
    """A rope, and a cloth hung up by two corners, whipped to and fro: thirty turns of rows and columns would leave 9 and 26 %."""
    lattice = Lattice(1, rows, cols, 0.05, 1e-3, pinned=(0, cols - 1))
    links = Structural(20.0, 0.002), Shear(5.0, 0.002)
    sim = Simulator(Scene(lattice, (Gravity(), *links, StrainLimit(0.05)), dtype=dtype))
    pose = sim.positions
    pose[..., 0] *= 0.8
    sim.set_positions(pose)
    worst = 0.0
    for turn in range(300):
        sim.set_mast((0.3 * np.sin(0.4 * turn), 0.3 * np.cos(0.3 * turn) - 0.3, 0.0), yaw=0.8 * np.sin(0.5 * turn))
        for _ in range(4):
            sim.step()
            worst = max(worst, largest(sim))
    assert 0.0499 < worst <= most(0.05, dtype)
    assert sim.strain_limit_misses == [0]


def test_misses_are_those_that_an_outside_check_counts():
    """Few iterations, several copies, one call of many steps or one by one."""
    scene = presets.flag(8, 12, stiffness=10.0).adding(STRONG, StrainLimit(0.0, iterations=1))
    counts = np.zeros(2, int)
    sim = Simulator(scene, copies=2)
    sim.set_wind(mean=[[0.0, 0.0, 0.0], [0.05, 0.01, 0.0]])
    with warnings.catch_warnings(record=True, action="always") as seen:
        for _ in range(200):
            sim.step()
            counts += [strains(x, scene.lattice).max() > TOLERANCE for x in sim.positions]
    assert [str(warning.message)[:28] for warning in seen] == ["StrainLimit does not hold: 1"]
    np.testing.assert_array_equal(sim.strain_limit_misses, counts)
    assert counts.all()
    other = Simulator(scene, copies=2)
    other.set_wind(mean=[[0.0, 0.0, 0.0], [0.05, 0.01, 0.0]])
    frame = other.frame()
    with pytest.warns(RuntimeWarning, match="StrainLimit does not hold"):
        other.step_into(200, frame)
    np.testing.assert_array_equal(other.strain_limit_misses, counts)
    np.testing.assert_array_equal(Simulator(presets.flag(4, 5), copies=3).strain_limit_misses, 0)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_mast_that_jumps_away_gets_its_flag_back(dtype):
    sim = Simulator(presets.flag(8, 12, dtype=dtype).adding(StrainLimit(0.1)))
    for jump in (0.3, 3.0, 300.0):
        sim.set_mast((0.0, jump, 0.0))
        sim.step(1)
        assert np.isfinite(sim.positions).all()
        for _ in range(200):
            sim.step(1)
        # where coordinates are large, float32 knows a link's length less well
        assert largest(sim) <= most(0.1, dtype) + 4 * np.finfo(dtype).eps * jump / 0.1


# -- closed forms ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("taper", [1.0, 0.25])
def test_two_particles_share_the_correction_by_their_masses(taper):
    """x' = x +- (d - L) w_i / (w_1 + w_2) along the link; v' likewise over h: both then move with their common velocity."""
    scene = chain(2, (StrainLimit(0.1),), taper=taper)
    masses, h = scene.lattice.masses, 1e-2
    v = np.array([[0.0, 1.0, 0.0], [3.0, 1.0, -2.0]])
    start = scene.lattice.rest_positions.reshape(2, 3) * 1.1
    sim = Simulator(scene)
    sim.set_positions(start.reshape(1, 1, 2, 3))
    sim.set_velocities(v.reshape(1, 1, 2, 3))
    sim.step(1)
    moved = start + h * v
    link = moved[1] - moved[0]
    length = np.linalg.norm(link)
    share = (1 / masses) / (1 / masses).sum()
    correction = (length - 1.1) * share[:, None] * np.array([[1.0], [-1.0]]) * link / length
    np.testing.assert_allclose(sim.positions.reshape(2, 3), moved + correction, rtol=0, atol=2e-6)
    np.testing.assert_allclose(sim.get_state().velocities[0].T, v + correction / h, rtol=0, atol=2e-4)


def test_a_pendulum_stays_on_its_circle():
    """Speed at the lowest point from the fall alone, v^2 = 2 g L (1 - cos 60 deg), up to what the steps dissipate."""
    reach = 1.1
    sim = Simulator(chain(2, (Gravity(), StrainLimit(0.1)), "edge").replace(timestep=1e-4))
    angle = np.pi / 3
    sim.set_positions(np.array([[0.0, 0, 0], [reach * np.sin(angle), 0, -reach * np.cos(angle)]]).reshape(1, 1, 2, 3))
    fastest, radius = 0.0, []
    for _ in range(12000):
        sim.step(1)
        fastest = max(fastest, np.linalg.norm(sim.get_state().velocities[0, :, 1]))
        radius.append(np.linalg.norm(sim.get_state().positions[0, :, 1]))
    assert min(radius) > reach * (1 - 1e-6)
    assert max(radius) < reach * (1 + 1e-6)
    assert fastest == pytest.approx(np.sqrt(2 * 9.81 * reach * (1 - np.cos(angle))), rel=2e-3)


def test_a_hanging_chain_bears_its_weight_at_once():
    """All links at the limit: nothing moves, for any number of links and at a timestep far beyond any spring's."""
    lattice = Lattice(1, 40, 1, 0.1, 1.0, pinned=(39,))
    sim = Simulator(Scene(lattice, (Gravity(), StrainLimit(0.1)), timestep=1e-2))
    pose = 1.1 * (sim.positions[0] - sim.positions[0, 0, -1])
    sim.set_positions(pose)
    sim.step(500)
    assert np.abs(sim.positions[0] - pose).max() < 1e-5 * lattice.extent[1]


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 2), (1, 2, 1), (2, 2, 2), (2, 1, 5), (1, 5, 1), (1, 2, 2)])
@pytest.mark.parametrize("pinned", ["edge", "sleeve", "none", "ends"])
def test_small_lattices(shape, pinned):
    scene = Scene(Lattice(*shape, (0.1, 0.2), 0.01, 0.5, pinned), (Gravity(), Structural(1.0), StrainLimit(0.0)))
    sim = Simulator(scene, copies=2)
    sim.set_velocities(np.random.default_rng(0).standard_normal((*shape, 3)))
    for _ in range(20):
        sim.step(1)
        assert strains(sim.positions, scene.lattice).max(initial=0.0) <= most(0.0)


@pytest.mark.parametrize("dimensions", [1, 2])
def test_ropes_and_sheets(dimensions):
    """A rope's link is the slanted line between its ends, which stay a spacing apart along x."""
    lattice = Lattice(1, 1, 12, 0.1, 0.01, pinned="ends", dimensions=dimensions)
    sim = Simulator(Scene(lattice, (Gravity(), Structural(1.0, 0.01), StrainLimit(0.1))))
    sim.set_velocities([[[[0.0, 0.0, 1.0 + col] for col in range(12)]]])
    worst = 0.0
    for _ in range(500):
        sim.step(1)
        worst = max(worst, largest(sim))
    assert 0.0999 < worst <= most(0.1) + TOLERANCE * (dimensions == 1)


@pytest.mark.parametrize("wrong", [{"stretch": -0.1}, {"stretch": np.nan}, {"iterations": 0}])
def test_wrong_arguments_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        StrainLimit(**wrong)
