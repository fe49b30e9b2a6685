"""Checks every effect against its uncompiled code, its energy, the symmetries it must have and the bounds it declares."""

import dataclasses
import pickle

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, compose
from flag_env.physics.effects import (
    AirDrag,
    AirPressure,
    Bending,
    CosineWind,
    CrossLayer,
    Gravity,
    Gusts,
    LinkEffect,
    Shear,
    Structural,
)
from flag_env.physics.effects.base import Setting
from flag_env.physics.jit import jit

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
]
LATTICE = Lattice(2, 3, 4, (0.1, 0.12, 0.15), 0.02, 0.3, "none")
LAG = 0.25
STRENGTHS = {"stiffness", "viscosity", "acceleration", "rate", "amplitude", "mean", "density"}

every_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: f"{effect!r}".replace(" ", ""))


@jit
def compiled_forces(effects, copy, x, v, f, scratch, lag):
    compose.forces(effects, copy, x, v, f, scratch, lag)


def bind(effect, dtype, lattice=LATTICE):
    return effect.bind(Setting(lattice, np.dtype(dtype), copies=2, timestep=1e-3, seed=0, bound={}))


def forces(effect, x, v, function=compiled_forces, dtype="float64", lattice=LATTICE):
    """Force on every particle [N], shape (particles, 3)."""
    bound = bind(effect, dtype, lattice)
    f, scratch = np.full((2, 3, lattice.size), np.nan, dtype)
    x, v = (np.ascontiguousarray(np.reshape(a, (-1, 3)).T, dtype) for a in (x, v))
    function((bound,), 1, x, v, f, scratch, LAG)
    assert f.dtype == dtype
    return f.T.copy()


def pose(seed=0, stretch=1.1):
    random = np.random.default_rng(seed)
    x = stretch * LATTICE.rest_positions.reshape(-1, 3) + 0.03 * random.standard_normal((LATTICE.size, 3))
    return x, random.standard_normal((LATTICE.size, 3))


def without_strength(effect):
    names = {field.name for field in dataclasses.fields(effect)} & STRENGTHS
    assert names
    return dataclasses.replace(effect, **{name: 0.0 * np.array(getattr(effect, name)) for name in names})


@pytest.fixture(scope="module")
def uncompiled(run_python, tmp_path_factory):
    """Forces from the same sources run as plain Python, by (effect number, dtype)."""
    folder = tmp_path_factory.mktemp("uncompiled")
    with (folder / "cases").open("wb") as file:
        pickle.dump([(bind(effect, d), d, *pose()) for effect in EFFECTS for d in ("float64", "float32")], file)
    script = f"""
import pickle, numpy as np, numba
from flag_env.physics import compose
assert numba.config.DISABLE_JIT
result = []
for bound, dtype, x, v in pickle.load(open({str(folder / "cases")!r}, "rb")):
    f, scratch = np.full((2, 3, len(x)), np.nan, dtype)
    x, v = (np.ascontiguousarray(a.T, dtype) for a in (x, v))
    with np.errstate(all="ignore"):
        compose.forces((bound,), 1, x, v, f, scratch, {LAG})
    result.append(f.T.copy())
pickle.dump(result, open({str(folder / "forces")!r}, "wb"))
"""
    run_python(script, NUMBA_DISABLE_JIT="1")
    with (folder / "forces").open("rb") as file:
        found = iter(pickle.load(file))
    return {(number, d): next(found) for number in range(len(EFFECTS)) for d in ("float64", "float32")}


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@every_effect
def test_compiled_code_computes_what_its_source_says(effect, dtype, uncompiled):
    expected = uncompiled[EFFECTS.index(effect), dtype]
    assert expected.dtype == dtype
    found = forces(effect, *pose(), dtype=dtype)
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(found, expected, rtol=0, atol=4 * np.finfo(dtype).eps * np.abs(expected).max())


@every_effect
def test_single_precision_agrees_with_double(effect):
    double, single = (forces(effect, *pose(), dtype=dtype) for dtype in ("float64", "float32"))
    np.testing.assert_allclose(single, double, rtol=0, atol=1e-5 * np.abs(double).max())
    bound = bind(effect, "float32")
    kept = bound.state() if hasattr(bound, "state") else ()
    for name, value in bound._asdict().items():
        if np.issubdtype(np.asarray(value).dtype, np.floating) and name not in kept:
            assert np.asarray(value).dtype == np.float32, name


@every_effect
def test_no_strength_no_effect(effect):
    nothing = without_strength(effect)
    assert not forces(nothing, *pose()).any()
    x, v = (a.reshape(*LATTICE.shape, 3) for a in pose())
    ends = []
    for effects in ((), (nothing,)):
        sim = Simulator(Scene(LATTICE, effects, timestep=1e-3))
        sim.set_positions(x)
        sim.set_velocities(v)
        sim.step(200)
        ends.append(sim.positions)
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-12)


@every_effect
def test_internal_forces_sum_to_nothing(effect):
    x, v = pose()
    f = forces(effect, x, v)
    if isinstance(effect, LinkEffect):
        np.testing.assert_allclose(f.sum(axis=0), 0, atol=1e-14 * np.abs(f).sum())
        torque = np.cross(x, f)
        brakes = effect.damping == "isotropic" and effect.viscosity > 0
        assert (np.abs(torque.sum(axis=0)).max() < 1e-14 * np.abs(torque).sum()) != brakes
    else:
        assert np.abs(f.sum(axis=0)).max() > 1e-3 * np.abs(f).sum()


@every_effect
def test_force_is_minus_the_slope_of_the_energy(effect):
    x, v = pose()
    if effect.energy(LATTICE, x[None]) is None:
        assert isinstance(effect, (AirDrag, AirPressure, CosineWind, Gusts))  # not conservative
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
    """-dF/dx <= stiffness, -dF/dv <= damping as matrices: what the step limit rests on."""
    n = LATTICE.size
    stiffness, damping = np.zeros((2, n, n))
    for term in effect.link_terms(LATTICE):
        for t in range(n - term.family.offset):
            pair = np.zeros(n)
            pair[[t, t + term.family.offset]] = 1, -1
            stiffness += term.stiffness[t] * np.outer(pair, pair)
            damping += term.viscosity[t] * np.outer(pair, pair)
    drag = effect.drag(LATTICE)
    damping += np.diag(np.zeros(n) if drag is None else drag)
    for seed, stretch in ((0, 1.1), (1, 0.4), (2, 3.0), (3, 0.0)):
        x, v = pose(seed, stretch)
        for bound, moved, h in ((stiffness, 0, 1e-6), (damping, 1, 1e-3)):
            slope = np.empty((3 * n, 3 * n))
            for i, index in enumerate(np.ndindex(x.shape)):
                shift = np.zeros_like(x)
                shift[index] = h
                at = [[x + sign * shift, 0 * v] if moved == 0 else [x, v + sign * shift] for sign in (1, -1)]
                slope[:, i] = (forces(effect, *at[0]) - forces(effect, *at[1])).ravel() / (2 * h)
            spare = np.kron(bound, np.eye(3)) + (slope + slope.T) / 2
            assert np.linalg.eigvalsh(spare).min() > -1e-5 * max(1.0, np.abs(slope).max())


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@every_effect
def test_forces_are_finite_where_particles_meet(effect, dtype):
    v = pose()[1]
    for scale in (0.0, 1e-25, 1e-18, 1e-10):
        assert np.isfinite(forces(effect, scale * pose()[0], v, dtype=dtype)).all()
    short = dataclasses.replace(LATTICE, spacing=1e-30)
    assert np.isfinite(forces(effect, short.rest_positions, v, dtype=dtype, lattice=short)).all()


@every_effect
def test_copies_are_independent(effect):
    scene = Scene(LATTICE, (effect,))
    sims = Simulator(scene, copies=2), Simulator(scene)
    x, v = (a.reshape(*LATTICE.shape, 3) for a in pose())
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
