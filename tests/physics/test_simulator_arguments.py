"""Bad arguments of scenes, effects and simulators are refused by name and value, and change nothing."""

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, State, effects, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, Shear, Structural
from flag_env.physics.integrators import Leapfrog
from tests.physics.test_simulator_state import bits, same, windy

NOT_WHOLE = [(2.5, TypeError), ("3", TypeError), (True, TypeError), (None, TypeError)]
NOT_COUNT = [*NOT_WHOLE, (0, ValueError), (-1, ValueError)]
NOT_NUMBER = [
    ("1", TypeError),
    (True, TypeError),
    (None, TypeError),
    ([1.0], TypeError),
    (np.nan, ValueError),
    (np.inf, ValueError),
]
NOT_SIZE = [*NOT_NUMBER, (-1.0, ValueError)]
NOT_POSITIVE = [*NOT_SIZE, (0.0, ValueError)]
NOT_VECTOR = [
    ("abc", TypeError),
    (1.0, ValueError),
    ((1.0, 2.0), ValueError),
    ((1.0, np.nan, 0.0), ValueError),
    ((0.0, 0.0, np.inf), ValueError),
    ((1.0, (2.0, 3.0), 4.0), TypeError),
]
NOT_BOOL = [("yes", TypeError), (1, TypeError), (None, TypeError)]
LATTICE = Lattice(1, 2, 3)


def table(make, **arguments):
    return [(make, name, value, error) for name, cases in arguments.items() for value, error in cases]


CONSTRUCTORS = [
    *table(Lattice, layers=NOT_COUNT, rows=NOT_COUNT, cols=NOT_COUNT, mass=NOT_POSITIVE, taper=NOT_POSITIVE),
    *table(Lattice, spacing=[*(c for c in NOT_POSITIVE if c[0] != [1.0]), ((1.0,), ValueError), ((1.0, 0.0), ValueError)]),
    *table(
        Lattice, pinned=[("top", ValueError), ((1, 640), ValueError), ((-1,), ValueError), ((0.5,), TypeError), (3, TypeError)]
    ),
    *table(
        lambda **one: Scene(**{"lattice": LATTICE, **one}),
        lattice=[(None, TypeError), ("flag", TypeError)],
        effects=[((1,), TypeError), ((Gravity,), TypeError), ((Gravity(), Gravity(1.0)), ValueError), (3, TypeError)],
        integrator=[(Leapfrog, TypeError), ("Leapfrog", TypeError), (None, TypeError)],
        timestep=[(0.0, ValueError), (-1.0, ValueError), (np.nan, ValueError), ("fast", ValueError), (None, TypeError)],
        dtype=[("float16", ValueError), ("int64", ValueError), ("double double", ValueError)],
        allow_unstable=NOT_BOOL,
        perturbation=NOT_SIZE,
    ),
    *table(Gravity, acceleration=NOT_NUMBER, tapered=NOT_BOOL),
    *table(AirDrag, rate=NOT_SIZE),
    *table(CosineWind, amplitude=NOT_VECTOR, frequency=NOT_VECTOR, mean=NOT_VECTOR, phase=NOT_VECTOR),
    *(
        case
        for kind in (Structural, Shear, Bending, CrossLayer)
        for case in table(
            kind, stiffness=NOT_SIZE, viscosity=NOT_SIZE, damping=[("both", ValueError), (1, ValueError)], tapered=NOT_BOOL
        )
    ),
    *table(
        lambda **one: Simulator(**{"scene": Scene(LATTICE), **one}),
        scene=[(None, TypeError), (LATTICE, TypeError)],
        copies=NOT_COUNT,
        seed=[*NOT_WHOLE, (-1, ValueError)],
        threads=[*(c for c in NOT_COUNT if c[0] is not None)],
    ),
    *table(presets.flag, rows=NOT_COUNT, cols=NOT_COUNT, length=NOT_POSITIVE, height=NOT_POSITIVE, density=NOT_POSITIVE),
    *table(presets.flag, taper=NOT_POSITIVE, stiffness=NOT_SIZE, viscosity=NOT_SIZE, dtype=[("int64", ValueError)]),
    *table(presets.report_flag, layers=[(0, ValueError), (3, ValueError), ("1", ValueError)], rows=NOT_COUNT, cols=NOT_COUNT),
    *table(Scene(LATTICE).scaled, stiffness=NOT_SIZE, viscosity=NOT_SIZE),
]


@pytest.mark.parametrize(("make", "name", "value", "error"), CONSTRUCTORS)
def test_bad_arguments_are_refused_by_name_and_value(make, name, value, error):
    with pytest.raises(error) as caught:
        make(**{name: value})
    message = str(caught.value)
    assert name in message
    if not isinstance(value, (tuple, list, float)) or (isinstance(value, float) and make is not CosineWind):
        assert repr(value) in message or str(value) in message


def test_unknown_kinds_and_fields_are_refused():
    with pytest.raises(TypeError, match="kinds must be effect classes"):
        Scene(LATTICE).without("Shear")
    with pytest.raises(TypeError, match="speed"):
        Scene(LATTICE).replace(speed=3)
    with pytest.raises(NotImplementedError, match="bind"):
        effects.Effect().bind(None)


GOOD = np.zeros((1, 6, 7, 3))


def spoiled(value):
    array = GOOD.copy()
    array[0, 5, 6, 2] = value
    return array


ANGLES = (1.0, 2.0, 3.0)
CALLS = [
    *(("step", {"n": value}, error) for value, error in [*NOT_WHOLE, (-1, ValueError)]),
    *(("advance", {"seconds": value}, error) for value, error in NOT_SIZE),
    *(
        (f"set_{name}", {name: value}, error)
        for name in ("positions", "velocities")
        for value, error in [
            (np.zeros((6, 7, 3)), ValueError),
            (np.zeros((3, 1, 6, 7, 3)), ValueError),
            (1.0, ValueError),
            ("abc", TypeError),
            (spoiled(np.nan), ValueError),
            (spoiled(np.inf), ValueError),
        ]
    ),
    *(("set_mast", {"position": value}, error) for value, error in NOT_VECTOR),
    *(("set_mast", {"position": (1, 1, 1), "tilt": value}, error) for value, error in [(ANGLES, ValueError), ("a", TypeError)]),
    *(
        ("set_mast", {"position": (1, 1, 1), "yaw": value}, error)
        for value, error in [((1, 2, 3), ValueError), (np.nan, ValueError)]
    ),
    *(("set_wind", {"amplitude": (9, 9, 9), "frequency": value}, error) for value, error in NOT_VECTOR),
    *(("set_wind", {"mean": (9, 9, 9), "amplitude": value}, error) for value, error in NOT_VECTOR),
    *(("set_wind", {"amplitude": (9, 9, 9), "mean": value}, error) for value, error in [(np.zeros((3, 3)), ValueError)]),
    *(("set_parameters", {"stiffness_scale": value}, error) for value, error in NOT_SIZE),
    *(("set_parameters", {"viscosity_scale": value}, error) for value, error in NOT_SIZE),
    *(("set_state", {"state": value}, error) for value, error in [(None, TypeError), ("state", TypeError)]),
]


@pytest.mark.parametrize(("method", "arguments", "error"), CALLS)
def test_a_refused_call_names_its_argument_and_changes_nothing(method, arguments, error):
    sim = Simulator(windy(), copies=2)
    sim.step(5)
    before = bits(sim)
    with pytest.raises(error) as caught:
        getattr(sim, method)(**arguments)
    name = list(arguments)[-1]
    assert (name) in str(caught.value)
    assert bits(sim) == before
    untouched = Simulator(windy(), copies=2)
    untouched.step(5)
    for one in (sim, untouched):
        one.step(5)
    assert same(sim, untouched)


@pytest.mark.parametrize(
    ("copies", "error"),
    [
        ([2], ValueError),
        ([-1], ValueError),
        ([0.5], TypeError),
        (["0"], TypeError),
        (0, TypeError),
        (1.0, TypeError),
        (np.array(1), TypeError),
        (np.array([0.0, 1.0]), TypeError),
        (np.array([True, False]), TypeError),
        ("01", TypeError),
        ([[0], [1]], TypeError),
        ([None], TypeError),
    ],
)
def test_copies_out_of_range_are_refused(copies, error):
    sim = Simulator(windy(), copies=2)
    state = sim.get_state()
    sim.step(5)
    before = bits(sim)
    with pytest.raises(error, match="copies must be"):
        sim.set_state(state, copies=copies)
    assert bits(sim) == before
    assert isinstance(state, State)


def test_wind_in_a_scene_without_wind_is_refused():
    with pytest.raises(ValueError, match=r"CosineWind\(\)"):
        Simulator(windy().without(CosineWind)).set_wind(amplitude=(1, 1, 1))


def test_numbers_too_large_for_the_scenes_arithmetic_are_refused():
    sim = Simulator(windy("float32"))
    before = bits(sim)
    for setter in (sim.set_positions, sim.set_velocities):
        with pytest.raises(ValueError, match=r"1e\+300"):
            setter(spoiled(1e300))
        assert bits(sim) == before
