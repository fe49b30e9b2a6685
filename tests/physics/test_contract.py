"""What an effect must offer is checked when a scene is made; several of a kind are told apart by name."""

import pickle
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, effects, integrators, max_timestep, presets
from flag_env.physics.compiling import jit
from flag_env.physics.effects import Attachment, Effect, LinearBound
from flag_env.physics.limits import limited_by

DOT = Lattice(1, 1, 1, mass=0.5, pinned="none")


class NoBound(Effect):
    def bind(self, context):
        return ()


class NoBind(Effect):
    def linear_bound(self, lattice):
        return LinearBound()


@dataclass(frozen=True)
class Given(Effect):
    """An effect with any data and any bound."""

    data: Any = None
    bound: Any = LinearBound()  # noqa: RUF009  (immutable)

    def bind(self, context):
        return self.data

    def linear_bound(self, lattice):
        return self.bound


class Empty(NamedTuple):
    weight: float = 1.0


class Misspelt(NamedTuple):
    weight: float = 1.0

    @staticmethod
    @jit
    def forces(data, copy, x, v, f, effect_work, lag):
        f[0, 0] += data.weight


class Short(NamedTuple):
    weight: float = 1.0

    @staticmethod
    @jit
    def force(data, copy, x, v, f):
        f[0, 0] += data.weight


class Plain(NamedTuple):
    weight: float = 1.0

    @staticmethod
    def force(data, copy, x, v, f, effect_work, lag):
        f[0, 0] += data.weight


class Untyped(NamedTuple):
    weight: Any

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        f[0, 0] += 1.0


class Fine(NamedTuple):
    weight: float = 1.0

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        f[0, 0] += data.weight


@dataclass(frozen=True)
class Anchor(Effect):
    """Declares a stiffness that is no link."""

    stiffness: float = 0.0

    def bind(self, context):
        return Fine()

    def linear_bound(self, lattice):
        return LinearBound(stiffness=np.full(lattice.size, self.stiffness))


@pytest.mark.parametrize(
    ("effect", "error", "message"),
    [
        (NoBound(), TypeError, r"effect NoBound must define linear_bound\(self, lattice\)"),
        (NoBind(), TypeError, r"effect NoBind must define bind\(self, context\)"),
        (Given(None), TypeError, r"bind\(context\) of effect Given must return a NamedTuple .*, got None"),
        (Given(Empty()), TypeError, r"effect Given must have a hook on Empty: force\(data, .*, lag\) or "),
        (Given(Misspelt()), TypeError, r"'forces'.* did you mean force\(data, copy, x, v, f, effect_work, lag\)\?"),
        (Given(Short()), TypeError, r"hook force of effect Given must take force\(data, .*, lag\), got 5 arguments"),
        (Given(Plain()), TypeError, r"hook force of effect Given must be compiled: .*@jit"),
        (Given(Untyped(object())), TypeError, r"field 'weight' of Untyped of effect Given must be a number"),
        (Given(Fine(), 3.0), TypeError, r"linear_bound\(lattice\) of effect Given must return a LinearBound, got 3.0"),
        (
            Given(Fine(), LinearBound(stiffness=np.ones(2))), ValueError,
            r"stiffness in linear_bound\(lattice\) of effect Given must have the shape \(1,\), got \(2,\)",
        ),
        (Given(Fine(), LinearBound(drag=-np.ones(1))), ValueError, r"drag in linear_bound.* must be finite and >= 0"),
    ],
)  # fmt: skip
def test_what_cannot_take_part_is_refused_when_the_scene_is_made(effect, error, message):
    with pytest.raises(error, match=message):
        Scene(DOT, (effect,))


def test_what_an_outsider_declares_sets_the_limit():
    """A spring to a point, mass m: leapfrog is stable below 2 / sqrt(k / m), whoever wrote the spring."""
    own = Scene(DOT, (Anchor(200.0),), integrators.Leapfrog())
    ours = Scene(DOT, (Attachment(stiffness=200.0),), integrators.Leapfrog())
    assert max_timestep(own) == pytest.approx(2.0 / np.sqrt(400.0), rel=1e-6)
    assert max_timestep(ours) == max_timestep(own)
    assert limited_by(ours) == "the stiffness of Attachment"


@pytest.mark.parametrize(
    "kind", [integrators.Leapfrog, integrators.LFAB, integrators.RK4, integrators.Strang, integrators.Implicit]
)
@pytest.mark.parametrize("viscosity", [0.0, 2.0])
def test_an_attached_mass_swings_as_a_damped_oscillator(kind, viscosity):
    """m x'' + z x' + k (x - p) = 0 in closed form: the error falls with the declared order, and is small."""
    k, m, point = 200.0, 0.5, np.array([0.1, -0.2, 0.3])
    scene = Scene(DOT, (Attachment((0, 0, 0), point, k, viscosity),), kind())
    rate = viscosity / (2 * m)
    w, errors = np.sqrt(k / m - rate**2), []
    for finer in (20, 40):
        sim, worst = Simulator(scene.replace(timestep=Simulator(scene).timestep / finer)), 0.0
        for _ in range(10 * finer):
            sim.step(1)
            t = sim.time
            exact = point * (1 - np.exp(-rate * t) * (np.cos(w * t) + rate / w * np.sin(w * t)))
            worst = max(worst, np.abs(sim.positions[0, 0, 0, 0] - exact).max())
        errors.append(worst)
    assert errors[0] / errors[1] == pytest.approx(2.0**kind.order, rel=0.15)
    assert errors[1] < 2e-2


def test_a_stiff_anchor_stays_stable_at_the_automatic_step():
    """A corner held a thousand times stiffer than the cloth: without its bound the step would be fifty times too long."""
    corner = Attachment((0, 9, 15), (1.4, 0.0, 1.0), 3e5, 1.0)
    for kind in (integrators.Leapfrog, integrators.LFAB, integrators.RK4, integrators.Strang):
        scene = presets.flag(10, 16).adding(corner).replace(integrator=kind())
        sim = Simulator(scene)
        sim.advance(1.0)
        assert np.linalg.norm(sim.positions[0, 0, 9, 15] - corner.point) < 1e-3


def test_several_of_a_kind_by_name():
    first, second = (Attachment((0, row, 3), (0.5, 0.0, row), 50.0, name=name) for row, name in ((0, "low"), (2, "high")))
    scene = Scene(Lattice(1, 3, 4), (effects.Structural(), first, second))
    assert scene.adding(Attachment((0, 0, 3), (0.6, 0.0, 0.0), 50.0, name="low")).effects[1].point == (0.6, 0.0, 0.0)
    assert len(scene.adding(Attachment((0, 1, 3), name="middle")).effects) == 4
    assert len(scene.without(Attachment).effects) == 1
    with pytest.raises(ValueError, match=r"at most one effect of a kind and a name, got several of Attachment 'low'"):
        Scene(scene.lattice, (first, first))
    with pytest.raises(ValueError, match=r"name must be None or letters, .* got 'a b'"):
        Attachment(name="a b")
    sim = Simulator(scene, copies=2)
    assert {"attachment_low", "attachment_high", "structural", "kinetic"} == set(sim.energy())
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(pickle.loads(pickle.dumps(scene))) == hash(scene)


def test_the_point_moves_while_it_runs_and_belongs_to_the_state():
    scene = Scene(DOT, (Attachment(stiffness=200.0, viscosity=10.0, name="hand"),))
    sim = Simulator(scene, copies=2)
    sim.set_input(Attachment, "point", [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]], name="hand")
    state = sim.get_state()
    sim.advance(5.0)
    np.testing.assert_allclose(sim.positions[:, 0, 0, 0], [[0.1, 0, 0], [0, 0.2, 0]], atol=1e-6)
    again = Simulator(scene, copies=2)
    again.set_state(state)
    again.advance(5.0)
    np.testing.assert_array_equal(again.positions, sim.positions)
    for arguments, message in (
        ((Attachment, "point", (0, 0, 0)), r"got .*Attachment.* and None; it has Attachment 'hand'"),
        ((Attachment, "stiffness", 3.0, "hand"), r"field must be one of the inputs of Attachment, \('point',\), got 'stiffness'"),
        ((Attachment, "point", (0, np.nan, 0), "hand"), r"point must be finite"),
    ):
        with pytest.raises(ValueError, match=message):
            sim.set_input(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"particle": (0, 0)}, r"particle must be \(layer, row, col\), got \(0, 0\)"),
        ({"particle": (0, 0, -1)}, r"particle must be at least 0, got -1"),
        ({"point": (0, np.inf, 0)}, r"point must be finite"),
        ({"stiffness": -1.0}, r"stiffness must be .*>= 0"),
        ({"particle": (0, 1, 0)}, r"particle must be \(layer, row, col\) below \(1, 1, 1\), got \(0, 1, 0\)"),
    ],
)
def test_an_attachment_checks_its_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        Scene(DOT, (Attachment(**arguments),))
