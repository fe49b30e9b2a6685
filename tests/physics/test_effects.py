"""The contract of effects: every promise is tried on every effect that it applies to, whether force or correction.

A force acts in `force`, a correction (collision, strain limit, tearing) in `project`; the battery runs both of each.
"""

import dataclasses
import math
import pickle

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator
from flag_env.physics.compiling import jit, step
from flag_env.physics.effects import (
    AirDrag,
    AirPressure,
    Attachment,
    Bending,
    CosineWind,
    CrossLayer,
    Gravity,
    Gusts,
    LinkEffect,
    MastCollision,
    SelfCollision,
    Shear,
    StrainLimit,
    Structural,
    Tearing,
)
from flag_env.physics.effects.base import BindContext
from flag_env.physics.effects.links import link_groups
from flag_env.physics.runtime.binding import bind

EFFECTS = [  # a new effect joins with one line
    Gravity(3.0),
    Gravity(3.0, tapered=False),
    *(kind(200.0, 0.0) for kind in (Structural, Shear, Bending, CrossLayer)),
    *(kind(200.0, 0.3, tapered=True) for kind in (Structural, Shear, Bending, CrossLayer)),
    *(kind(200.0, 0.3, "axial") for kind in (Structural, Shear, Bending, CrossLayer)),
    AirDrag(2.0),
    CosineWind((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (0.5, -0.5, 0.1), (0.1, 0.2, 0.3)),
    Gusts(1.0, 2.0, 5.0, (3.0, 1.0, -0.5), 2.0),
    AirPressure(normal=1.2, lift=0.4, friction=0.1, max_speed=60.0),
    AirPressure(gusts=Gusts(0.0), max_speed=60.0),
    SelfCollision(),
    MastCollision(0.09),
    StrainLimit(),
    Tearing(0.2),
    Attachment((1, 2, 3), (0.4, 0.1, 0.2), 200.0, 0.3),
]
NOTHING = dict.fromkeys(("stiffness", "viscosity", "acceleration", "rate", "amplitude", "mean", "density"), 0.0)
NOTHING |= {"thickness": 0.0, "radius": 0.0, "stretch": math.inf, "strain": math.inf}
"""Values of parameters at which an effect does nothing, by name."""

INTERNAL = (LinkEffect, SelfCollision, StrainLimit, Tearing)
"""Effects of particles upon each other: no force and no change of momentum in sum."""

LATTICE = Lattice(2, 3, 4, (0.1, 0.12, 0.15), 0.02, 0.3, "none")
H = 1e-3
LAG = 0.25
LINKS = Structural(50.0, 0.1)
"""What `Tearing` tears, and moves the scenes of corrections."""

every_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: f"{effect!r}".replace(" ", ""))
both_dtypes = pytest.mark.parametrize("dtype", ["float64", "float32"])


def lattice_of(effect, lattice=LATTICE):
    """The lattice, clamped if the effect asks for a mast."""
    try:
        effect.check(lattice)
    except ValueError:
        return dataclasses.replace(lattice, pinned="edge")
    return lattice


def company(effect):
    """Effects that act on others come with some."""
    return (LINKS, effect) if effect.breaks else (effect,)


def bound_to(effect, dtype="float64", lattice=None):
    """The effect and its company as bound to two copies; inverse masses."""
    lattice = lattice_of(effect) if lattice is None else lattice
    links = link_groups(lattice, company(effect), 2, np.dtype(dtype))
    context = BindContext(lattice, np.dtype(dtype), copies=2, timestep=H, seed=0, links=links)
    return bind(company(effect), context), np.where(lattice.fixed, 0.0, 1.0 / lattice.masses).astype(dtype)


@jit
def compiled(effects, copy, x, v, f, effect_work, inverse_mass, seconds, lag):
    step.project(effects, copy, x, v, effect_work, inverse_mass, seconds)
    step.forces(effects, copy, x, v, f, effect_work, lag)


def act(effect, x, v, dtype="float64", lattice=None):
    """Positions and velocities after the corrections, and the forces there, each (particles, 3)."""
    data, inverse_mass = bound_to(effect, dtype, lattice)
    size = len(inverse_mass)
    f, effect_work = np.full((3, size), np.nan, dtype), np.full((6, 2 * size), np.nan, dtype)
    x, v = (np.array(np.reshape(a, (-1, 3)).T, dtype, order="C") for a in (x, v))
    compiled(data, 1, x, v, f, effect_work, inverse_mass, H, LAG)
    assert x.dtype == v.dtype == f.dtype == dtype
    return x.T.copy(), v.T.copy(), f.T.copy()


def forces(effect, x, v):
    """Force on every particle [N], shape (particles, 3)."""
    return act(effect, x, v)[2]


def pose(seed=0, stretch=0.9):
    """Crumpled: links too long, particles too near to each other and to the mast, all in motion."""
    random = np.random.default_rng(seed)
    x = stretch * LATTICE.rest_positions.reshape(-1, 3) + 0.03 * random.standard_normal((LATTICE.size, 3))
    return x, random.standard_normal((LATTICE.size, 3))


def without_strength(effect):
    names = {field.name for field in dataclasses.fields(effect)} & set(NOTHING)
    assert names
    none = {name: np.full_like(getattr(effect, name), NOTHING[name], float) for name in names}
    return dataclasses.replace(effect, **{name: value if value.ndim else float(value) for name, value in none.items()})


@pytest.fixture(scope="module")
def uncompiled(run_python, tmp_path_factory):
    """What the same sources do when run as plain Python, by (effect number, dtype)."""
    folder = tmp_path_factory.mktemp("uncompiled")
    with (folder / "cases").open("wb") as file:
        pickle.dump([(*bound_to(effect, d), d, *pose()) for effect in EFFECTS for d in ("float64", "float32")], file)
    script = f"""
import pickle, numpy as np, numba
from flag_env.physics.compiling import step
assert numba.config.DISABLE_JIT
result = []
for bound, inverse_mass, dtype, x, v in pickle.load(open({str(folder / "cases")!r}, "rb")):
    f, scratch = np.full((3, len(x)), np.nan, dtype), np.full((6, 2 * len(x)), np.nan, dtype)
    x, v = (np.array(a.T, dtype, order="C") for a in (x, v))
    with np.errstate(all="ignore"):
        step.project(bound, 1, x, v, scratch, inverse_mass, {H})
        step.forces(bound, 1, x, v, f, scratch, {LAG})
    result.append((x.T.copy(), v.T.copy(), f.T.copy()))
pickle.dump(result, open({str(folder / "results")!r}, "wb"))
"""
    run_python(script, NUMBA_DISABLE_JIT="1")
    with (folder / "results").open("rb") as file:
        found = iter(pickle.load(file))
    return {(number, d): next(found) for number in range(len(EFFECTS)) for d in ("float64", "float32")}


@both_dtypes
@every_effect
def test_compiled_code_computes_what_its_source_says(effect, dtype, uncompiled):
    for found, expected in zip(act(effect, *pose(), dtype), uncompiled[EFFECTS.index(effect), dtype], strict=True):
        assert expected.dtype == dtype
        np.testing.assert_allclose(found, expected, rtol=0, atol=4 * np.finfo(dtype).eps * np.abs(expected).max())


@every_effect
def test_it_acts_in_the_pose_that_the_battery_tries(effect):
    nothing = act(without_strength(effect), *pose())
    assert max(np.abs(a - b).max() for a, b in zip(act(effect, *pose()), nothing, strict=True)) > 1e-3


@every_effect
def test_single_precision_agrees_with_double(effect):
    for double, single in zip(*(act(effect, *pose(), dtype) for dtype in ("float64", "float32")), strict=True):
        np.testing.assert_allclose(single, double, rtol=0, atol=1e-5 * np.abs(double).max())
    data = bound_to(effect, "float32")[0][-1]
    kept = data.state() if hasattr(data, "state") else ()
    for name, value in data._asdict().items():
        entries = value if isinstance(value, tuple) else (value,)
        for dtype in (np.asarray(entry).dtype for entry in entries):
            if np.issubdtype(dtype, np.floating) and name not in kept:
                assert dtype == np.float32, name


@every_effect
def test_no_strength_no_effect(effect):
    """Neither at once nor on the way of a scene in motion."""
    nothing = without_strength(effect)
    x, v = pose()
    others = company(effect)[:-1]
    alone = act(others[0], x, v) if others else (x, v, np.zeros_like(x))
    for found, expected in zip(act(nothing, x, v), alone, strict=True):
        np.testing.assert_array_equal(found, expected)
    lattice = lattice_of(effect)
    moving = () if isinstance(effect, Structural) else (LINKS,)
    ends = []
    for effects in (moving, (*moving, nothing), (*moving, effect)):
        sim = Simulator(Scene(lattice, effects, timestep=H))
        sim.set_positions(x.reshape(*lattice.shape, 3))
        sim.set_velocities(v.reshape(*lattice.shape, 3))
        sim.step(200)
        ends.append(sim.positions)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12)
    assert np.abs(ends[2] - ends[0]).max() > 1e-3


@every_effect
def test_internal_forces_sum_to_nothing(effect):
    x, v = pose()
    after, speed, f = act(effect, x, v)
    impulse = (speed - v) * LATTICE.masses[:, None]
    shift = (after - x) * LATTICE.masses[:, None]
    size = [np.abs(each).sum() for each in (f, impulse, shift)]
    total = [np.abs(each.sum(axis=0)).max() for each in (f, impulse, shift)]
    if not isinstance(effect, INTERNAL):
        assert any(t > 1e-3 * s for t, s in zip(total, size, strict=True))
        return
    assert all(t <= 1e-14 * s for t, s in zip(total, size, strict=True))
    if isinstance(effect, LinkEffect):
        torque = np.cross(x, f)
        brakes = effect.damping == "isotropic" and effect.viscosity > 0
        assert (np.abs(torque.sum(axis=0)).max() < 1e-14 * np.abs(torque).sum()) != brakes


@every_effect
def test_force_is_minus_the_slope_of_the_energy(effect):
    x, v = pose()
    if effect.energy(LATTICE, x[None]) is None:  # not conservative
        assert isinstance(effect, (AirDrag, AirPressure, CosineWind, Gusts, SelfCollision, MastCollision, StrainLimit, Tearing))
        return
    h, slope = 1e-6, np.empty_like(x)
    for index in np.ndindex(x.shape):
        shift = np.zeros_like(x)
        shift[index] = h
        up, down = effect.energy(LATTICE, np.stack([x + shift, x - shift]))
        slope[index] = (up - down) / (2 * h)
    f = forces(effect, x, np.zeros_like(v))
    np.testing.assert_allclose(f, -slope, rtol=0, atol=2e-8 * np.abs(f).max())


@every_effect
def test_declared_bounds_hold_in_every_pose(effect):
    """-dF/dx <= stiffness, -dF/dv <= damping as matrices: what the step limit rests on. Corrections ask for nothing."""
    n = LATTICE.size
    stiffness, damping = np.zeros((2, n, n))
    bound = effect.linear_bound(LATTICE)
    for term in bound.links:
        for t in range(n - term.family.offset):
            pair = np.zeros(n)
            pair[[t, t + term.family.offset]] = 1, -1
            stiffness += term.stiffness[t] * np.outer(pair, pair)
            damping += term.viscosity[t] * np.outer(pair, pair)
    stiffness += np.diag(np.zeros(n) if bound.stiffness is None else bound.stiffness)
    damping += np.diag(np.zeros(n) if bound.drag is None else bound.drag)
    if not hasattr(bound_to(effect)[0][-1], "force"):
        assert not stiffness.any()
        assert not damping.any()
        return
    for seed, stretch in ((0, 1.1), (1, 0.4), (2, 3.0), (3, 0.0)):
        x, v = pose(seed, stretch)
        for data, moved, h in ((stiffness, 0, 1e-6), (damping, 1, 1e-3)):
            slope = np.empty((3 * n, 3 * n))
            for i, index in enumerate(np.ndindex(x.shape)):
                shift = np.zeros_like(x)
                shift[index] = h
                at = [[x + sign * shift, 0 * v] if moved == 0 else [x, v + sign * shift] for sign in (1, -1)]
                slope[:, i] = (forces(effect, *at[0]) - forces(effect, *at[1])).ravel() / (2 * h)
            spare = np.kron(data, np.eye(3)) + (slope + slope.T) / 2
            assert np.linalg.eigvalsh(spare).min() > -1e-5 * max(1.0, np.abs(slope).max())


@both_dtypes
@every_effect
def test_all_is_finite_where_particles_meet(effect, dtype):
    v = pose()[1]
    for scale in (0.0, 1e-25, 1e-18, 1e-10):
        assert np.isfinite(act(effect, scale * pose()[0], v, dtype)).all()
    short = dataclasses.replace(lattice_of(effect), spacing=1e-30)
    assert np.isfinite(act(effect, short.rest_positions, v, dtype, short)).all()


@every_effect
def test_copies_are_independent(effect):
    lattice = lattice_of(effect)
    scene = Scene(lattice, company(effect), timestep=H)
    sims = Simulator(scene, copies=2), Simulator(scene)
    x, v = (a.reshape(*lattice.shape, 3) for a in pose())
    sims[0].set_positions(np.stack([x, 1.5 * x]))
    sims[0].set_velocities(np.stack([v, -v]))
    sims[1].set_positions(x)
    sims[1].set_velocities(v)
    for sim in sims:
        sim.step(50)
    np.testing.assert_array_equal(sims[0].positions[0], sims[1].positions[0])
    np.testing.assert_array_equal(sims[0].velocities[0], sims[1].velocities[0])
    assert not np.array_equal(sims[0].positions[0], sims[0].positions[1])


@every_effect
def test_an_effect_is_a_value(effect):
    assert pickle.loads(pickle.dumps(effect)) == effect
    assert hash(dataclasses.replace(effect)) == hash(effect)
    with pytest.raises(dataclasses.FrozenInstanceError):
        effect.something = 1
