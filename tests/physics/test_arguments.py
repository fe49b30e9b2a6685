"""Numbers that are none, or that arithmetic cannot hold, are refused by the name of the argument, wherever one is taken."""

import inspect
import warnings
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, effects, presets

NOT_REAL = [
    1j, np.complex128(1), np.array(1j), "1", b"1", np.str_("1"), np.bytes_(b"1"), np.array("1"), True, np.bool_(True),
    np.array(True), np.array(None), np.array([1.0], object), np.datetime64("2020"), np.timedelta64(1), Decimal(1), object(),
    [[1.0, 2.0], 3.0],
]  # fmt: skip
BEYOND = [np.nan, 5e-324, 1e-320, -1e-320, np.array(1e-320), 1e-200, 1e200, 1e308, 10**400, np.nextafter(0, 1)]
BAD = NOT_REAL + BEYOND
TRIPLES = [(bad, 1.0, 1.0) for bad in BAD] + [np.array([1j, 0, 0]), np.array([1.0, 2.0, None]), np.array(["1", "2", "3"])]
LATTICE = Lattice(1, 2, 3)
VECTORS = {"mean", "amplitude", "frequency", "phase"}
KINDS = [
    effects.Gravity, effects.Structural, effects.Shear, effects.Bending, effects.CrossLayer, effects.CosineWind, effects.Gusts,
    effects.AirPressure, effects.AirDrag, effects.SelfCollision, effects.MastCollision, effects.StrainLimit, effects.Tearing,
]  # fmt: skip


def numbers(kind):
    """Arguments of an effect that take numbers."""
    return [name for name, it in inspect.signature(kind).parameters.items() if not isinstance(it.default, (bool, str))]


def refuse(make, name, values):
    for value in values:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a discarded imaginary part, say
            with pytest.raises((TypeError, ValueError)) as caught:
                make(**{name: value})
        assert name in str(caught.value), (name, value, caught.value)


@pytest.mark.parametrize("name", ["spacing", "mass", "taper"])
def test_lattice(name):
    refuse(Lattice, name, BAD)


def test_spacings_and_pins_and_counts():
    refuse(Lattice, "spacing", [(0.1, 1e-320), (0.1, 1j), np.array([0.1, 1j]), np.array([0.1, None]), np.array([[0.1, 0.2]])])
    refuse(Lattice, "pinned", [b"1", np.array([1.0]), np.array([1j]), np.array(["1"]), np.array(1), np.array([None]), (2**70,)])
    for name in ("layers", "rows", "cols", "dimensions"):
        refuse(Lattice, name, [*NOT_REAL, *BEYOND, 2.0, np.array(2)])


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_effects(kind):
    for name in numbers(kind):
        refuse(kind, name, TRIPLES if name in VECTORS else BAD)
        if name in ("intensity", "scale"):
            refuse(kind, name, TRIPLES)


def test_scenes():
    for name in ("timestep", "perturbation"):
        refuse(lambda **one: Scene(LATTICE, **one), name, [*BAD, np.array([1.0, 2.0])])
    for name in ("stiffness", "viscosity"):
        refuse(Scene(LATTICE).scaled, name, BAD)
    for name in ("length", "height", "density", "taper", "stiffness", "viscosity", "wind", "intensity"):
        refuse(presets.storm_flag, name, BAD)


@pytest.mark.parametrize(("name", "value"), [("mass", 1e-40), ("mass", 1e30), ("taper", 1e-30), ("spacing", 1e-25)])
def test_what_float32_cannot_divide_by_is_refused_there(name, value):
    lattice = Lattice(1, 2, 3, **{name: value})
    Scene(lattice)
    with pytest.raises(ValueError, match=f"{name}.* must be of a magnitude from .*dtype='float32'"):
        Scene(lattice, dtype="float32")


def test_a_running_simulator():
    sim, shape = Simulator(Scene(LATTICE, (effects.CosineWind(),), timestep=1e-3)), (1, 2, 3, 3)
    others = [np.zeros(shape).astype(kind) for kind in (complex, object, bool, str, "m8[s]")]
    refuse(sim.set_positions, "positions", others)
    refuse(sim.set_velocities, "velocities", others)
    triples = [np.zeros(3, complex), ("1", "2", "3"), [True] * 3, np.array([1.0, 2.0, None]), np.array([1, 2, "x"], object)]
    for call, names in ((sim.set_mast, ("position",)), (sim.set_wind, ("amplitude", "frequency", "mean"))):
        for name in names:
            refuse(call, name, triples)
    refuse(sim.set_mast, "yaw", [np.array(1j), True, "1"])
    refuse(sim.advance, "seconds", BAD)
    refuse(sim.set_parameters, "stiffness_scale", BAD)
    refuse(sim.set_parameters, "viscosity_scale", BAD)
    assert sim.time == 0.0
    assert not sim.velocities.any()


def test_numbers_of_every_real_kind_are_taken():
    for value in (0.5, np.float32(0.5), np.float64(0.5), np.array(0.5), np.longdouble(0.5), Fraction(1, 2)):
        assert Lattice(spacing=value, mass=value) == Lattice(spacing=0.5, mass=0.5)
    assert Lattice(spacing=np.array([0.1, 0.2])) == Lattice(spacing=(0.1, 0.2))
    assert effects.CosineWind(mean=np.array([1, 2, 3])) == effects.CosineWind(mean=(1.0, 2.0, 3.0))


@pytest.mark.parametrize("cols", [2, 68, 69, 75, 76, 77, 200])
def test_the_storms_pole_fits_between_mast_and_cloth(cols):
    """At the default size the columns of 76 stand 2 cm apart; the pole keeps its 2 cm wherever these fit."""
    scene = presets.storm_flag(20, cols)
    radius = next(effect.radius for effect in scene.effects if isinstance(effect, effects.MastCollision))
    assert radius == pytest.approx(min(0.02, 0.9 * 1.5 / (cols - 1)), rel=1e-12)


@pytest.mark.parametrize("size", [{"length": 0.1}, {"height": 0.1}, {"length": 1e-3, "height": 1e-3}, {"pinned": "sleeve"}])
def test_storms_of_every_size_can_be_made(size):
    assert presets.storm_flag(**size).lattice.rows == 20
