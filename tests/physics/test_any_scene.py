"""Scenes drawn by hypothesis: whatever is put together, the simulator keeps its promises or refuses by name.

The short form varies numbers, lattices and pins under steps that are compiled once; the long form draws effects and integrators
freely, so that nearly every example compiles a step of its own.
"""

import math
import pickle
from functools import partial

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, reject, settings
from hypothesis import strategies as st

from flag_env.physics import Diverged, Lattice, Scene, Simulator, effects, integrators, max_timestep

STILL_BUSY = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}
STEPS = 300


def between(low, high):
    return st.floats(low, high).map(lambda value: 0.0 if abs(value) < 1e-100 else value)


def powers(low, high):
    return between(low, high).map(lambda exponent: 10**exponent)


def vectors(reach):
    return st.tuples(*[between(-reach, reach)] * 3)


@st.composite
def lattices(draw, dimensions=(3,), least=1):
    """Any shape from one particle on, 1 x N and N x 1 among them; pinned by name or by number."""
    space = draw(st.sampled_from(dimensions))
    layers, rows, cols = draw(st.integers(1, 2 if space == 3 else 1)), draw(st.integers(least, 6)), draw(st.integers(least, 7))
    pinned = draw(
        st.sampled_from(["edge", "sleeve", "ends", "none"])
        | st.sets(st.integers(0, layers * rows * cols - 1), max_size=4).map(lambda found: tuple(sorted(found)))
    )
    spacing = draw(powers(-2, 0))
    return Lattice(
        layers, rows, cols, (spacing, spacing * draw(between(0.3, 3))), draw(powers(-4, 0)), draw(powers(-2, 0.3)), pinned, space
    )


SHARES = powers(-2, 1)


def links(kind, damping=("isotropic",), shares=SHARES):
    """Frequencies from 30 to 3000 rad/s for a particle of 10 g, damped by 1/100 to 10 of what is critical."""
    return st.builds(
        lambda stiffness, share, along, tapered: kind(stiffness, share * math.sqrt(stiffness * 0.01), along, tapered),
        powers(1, 5), shares, st.sampled_from(damping), st.booleans(),
    )  # fmt: skip


FAMILY = (effects.Structural, effects.Shear, effects.Bending)
WINDS = st.builds(effects.CosineWind, vectors(0.3), vectors(30), vectors(0.3), vectors(3))
AIR = st.builds(
    lambda mean, intensity: effects.AirPressure(mean=mean, gusts=effects.Gusts(intensity)), vectors(11), between(0, 5)
)
COLLISION = st.builds(effects.SelfCollision, st.none() | powers(-3, -0.5), between(0, 1), between(0, 0.7))
TEARING = st.builds(effects.Tearing, between(0.01, 1))
LIMIT = st.builds(effects.StrainLimit, between(0, 0.5), st.integers(1, 30))
GRAVITY, DRAG = st.builds(effects.Gravity, between(-20, 20)), st.builds(effects.AirDrag, between(0, 10))


POLE = st.builds(effects.MastCollision, powers(-3, -1))


def made(lattice, chosen, method, dtype):
    """A scene of these; an effect that does not go with the lattice must say so."""
    make = partial(Scene, lattice, tuple(chosen), method, dtype=dtype, perturbation=1e-3 * lattice.spacings[0])
    try:
        return make()
    except ValueError:
        names = "|".join(["radius", *(type(effect).__name__ for effect in chosen)])
        with pytest.raises(ValueError, match=names):
            make()
        return reject()


@st.composite
def prepared(draw):
    """One of three sets of classes, that of a storm among them, each compiled once; everything else free."""
    method, dtype, extra = draw(
        st.sampled_from(
            [
                (integrators.Leapfrog(), "float64", (WINDS,)),
                (integrators.LFAB(), "float32", (WINDS,)),
                (integrators.Leapfrog(), "float64", (AIR, COLLISION, POLE)),
            ]
        )
    )
    lattice = draw(lattices(least=2) if AIR in extra else lattices())
    chosen = [draw(strategy) for strategy in (GRAVITY, *(links(kind) for kind in FAMILY), DRAG, *extra)]
    return made(lattice, chosen, method, dtype)


@st.composite
def free(draw):
    """Any effects that go together, each with any numbers; every integrator, dtype and number of dimensions."""
    lattice = draw(lattices((3, 3, 3, 2, 1)))
    kinds = (*FAMILY, *((effects.CrossLayer,) if lattice.layers > 1 else ()))
    damping, shares = ("isotropic", "axial"), st.just(0.0) | SHARES
    offers = [GRAVITY, DRAG, LIMIT, TEARING, *(links(kind, damping, shares) for kind in kinds)]
    offers.append(draw(st.sampled_from([WINDS, AIR, st.builds(effects.Gusts, between(0, 5))])))
    offers += [COLLISION, POLE]
    chosen = [draw(strategy) for strategy in offers if draw(st.booleans())]
    method = draw(
        st.sampled_from(
            [
                *(integrators.Leapfrog(start) for start in ("report", "half_kick")),
                *(kind() for kind in (integrators.LFAB, integrators.RK4, integrators.ExplicitEuler)),
                *(kind(turns) for kind in (integrators.Strang, integrators.Implicit) for turns in (1, 2)),
            ]
        )
    )
    return made(lattice, chosen, method, draw(st.sampled_from(["float64", "float32"])))


def bits(sim):
    state = sim.get_state()
    arrays = [*state.arrays(), sim.positions, sim.velocities]
    return (sim.time, *(np.ascontiguousarray(array).tobytes() for array in arrays))


def shaken(scene, seed, **arguments):
    """A simulator whose particles set out at up to a spacing in ten steps."""
    sim = Simulator(scene, seed=seed % 1000, **arguments)
    fastest = min(0.1 * scene.lattice.spacings[0] / sim.timestep, 10.0)
    random = np.random.default_rng(seed).uniform(-fastest, fastest, sim.velocities.shape[1:])
    moving = ~scene.lattice.fixed.reshape(scene.lattice.shape)[..., None] & np.isin(range(3), scene.lattice.axes)
    sim.set_velocities(np.where(moving, random, 0.0))
    return sim


def keeps_its_promises(scene, seed, share):
    assert pickle.loads(pickle.dumps(scene)) == scene
    limit = max_timestep(scene)
    if limit == 0.0:  # nothing to run: it must say so
        with pytest.raises(ValueError, match=f"integrator {type(scene.integrator).__name__} is unstable at every timestep"):
            Simulator(scene)
        return
    sim, twin = (shaken(scene, seed, copies=copies) for copies in (2, 1))
    assert 0.0 < sim.timestep <= limit
    sim.step(STEPS // 2)  # at an automatic timestep none diverges
    state, thawed = sim.get_state(), pickle.loads(pickle.dumps(sim))
    sim.step(STEPS // 2)
    assert np.isfinite(sim.positions).all()
    assert np.isfinite(sim.velocities).all()
    end = bits(sim)
    thawed.step(STEPS // 2)
    assert bits(thawed) == end
    sim.set_state(pickle.loads(pickle.dumps(state)))
    sim.step(STEPS // 2)
    assert bits(sim) == end
    twin.step(STEPS // 2)
    twin.step(STEPS // 2)
    np.testing.assert_array_equal(twin.positions[0], sim.positions[0])
    np.testing.assert_array_equal(twin.velocities[0], sim.velocities[0])
    if math.isfinite(limit):
        above = scene.replace(timestep=(1.0 + share) * limit)
        with pytest.raises(ValueError, match="timestep must not exceed the scene's limit"):
            Simulator(above)
        wild = shaken(above.replace(allow_unstable=True), seed)
        caught = None
        try:
            wild.step(STEPS)
        except Diverged as lost:
            caught = lost
        assert wild.diverged.tolist() == [caught is not None]
        if caught is not None:
            assert 0.0 < caught.time <= wild.time * (1.0 + 1e-12)
        else:  # never silent
            assert np.isfinite(wild.get_state().positions).all()
            assert np.isfinite(wild.get_state().velocities).all()


@given(scene=prepared(), seed=st.integers(0, 2**32), share=powers(-6, 0.5))
@settings(max_examples=40, **STILL_BUSY)
def test_any_numbers(scene, seed, share):
    keeps_its_promises(scene, seed, share)


@pytest.mark.slow
@given(scene=free(), seed=st.integers(0, 2**32), share=powers(-6, 0.5))
@settings(max_examples=80, phases=(Phase.generate,), **STILL_BUSY)  # to shrink an example would compile for an hour
def test_any_effects(scene, seed, share):
    keeps_its_promises(scene, seed, share)
