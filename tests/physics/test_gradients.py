"""Derivatives of a run: the bits of the way forward, and the way back against differences of order eight and linear theory."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flag_env.physics import Lattice, Rollout, Scene, Simulator, effects, integrators, presets

STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
"""Central differences of order eight."""

ACTIONS, SECONDS = 3, 0.06
LFAB = integrators.LFAB()


def slope(f):
    """Derivative of f at 0."""
    return sum(weight * (f(step) - f(-step)) for step, weight in STENCIL)


def one_layer(integrator=LFAB, **changes):
    scene = presets.flag(rows=4, cols=5, stiffness=60.0, integrator=integrator, timestep=2e-3, perturbation=0.02)
    wind = effects.CosineWind(
        amplitude=(0.01, 0.02, 0.01), frequency=(3.0, 9.0, 5.0), mean=(0.03, 0.01, 0.0), phase=(0.1, 1.0, 2.0)
    )
    return scene.adding(wind, effects.Attachment((0, 3, 4), (0.9, 0.1, 0.9), 5.0, 0.01)).replace(**changes)


def two_layers():
    scene = presets.two_layer_flag(rows=3, cols=4, stiffness=60.0, timestep=1e-3, perturbation=0.02)
    kept = [replace(effect, damping="axial") if hasattr(effect, "damping") else effect for effect in scene.effects]
    bare = effects.Structural(stiffness=60.0, viscosity=0.0)
    return scene.replace(effects=tuple(kept), integrator=integrators.Leapfrog("half_kick")).adding(bare, effects.AirDrag(0.5))


def sheet():
    scene = presets.sheet(rows=3, cols=5, stiffness=60.0, integrator=integrators.RK4(), timestep=4e-3)
    shear = effects.Shear(20.0, 0.03, "axial")
    return scene.adding(shear, effects.CosineWind((0.02, 0.02, 0.02), (3.0, 3.0, 5.0), (0.03, 0.0, 0.01)))


SCENES = {
    "LFAB": one_layer,
    "Leapfrog": lambda: one_layer(integrators.Leapfrog()),
    "Strang": lambda: one_layer(integrators.Strang()),
    "two layers": two_layers,
    "sheet": sheet,
}


def pushed(scene, copies, seed=0):
    """A rollout, random inputs for it, and random derivatives of a loss."""
    rng = np.random.default_rng(seed)
    rollout = Rollout(scene, copies=copies)
    shape = (copies, *scene.lattice.shape, 3)
    held = np.zeros(3)
    held[list(scene.lattice.axes)] = 1.0
    rest = scene.lattice.rest_positions
    inputs = {
        "wind": 0.05 * rng.standard_normal((ACTIONS, copies, 3)),
        "mast": 0.1 * rng.standard_normal((ACTIONS, copies, 6)) * (1.0 if scene.lattice.dimensions == 3 else [1, 0, 1, 0, 1, 0]),
        "positions": rest + 0.02 * held * rng.standard_normal(shape),
        "velocities": 0.3 * held * rng.standard_normal(shape),
    }
    return rollout, inputs, held * rng.standard_normal(shape), 0.1 * held * rng.standard_normal(shape), held


def loss(rollout, inputs, dx, dv):
    """A linear function of where each copy ends, (copies,)."""
    x = rollout.run(seconds=SECONDS, **inputs)
    return ((dx * x) + (dv * rollout.velocities)).sum(axis=(1, 2, 3, 4))


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_by_inputs_agree_with_differences(name):
    scene = SCENES[name]()
    rollout, inputs, dx, dv, held = pushed(scene, 2)
    loss(rollout, inputs, dx, dv)
    gradient = rollout.pull_back(dx, dv)
    rng = np.random.default_rng(1)
    for what, size in (("wind", 3e-3), ("mast", 1e-3), ("positions", 3e-4), ("velocities", 1e-2)):
        direction = size * rng.standard_normal(inputs[what].shape) * (held if what in ("positions", "velocities") else 1.0)
        if what == "mast" and scene.lattice.dimensions == 2:
            direction *= [1, 0, 1, 0, 1, 0]
        along = slope(lambda h: loss(rollout, {**inputs, what: inputs[what] + h * direction}, dx, dv))  # noqa: B023
        product = getattr(gradient, what) * direction
        copies = 1 if what in ("wind", "mast") else 0
        found = product.sum(axis=tuple(axis for axis in range(product.ndim) if axis != copies))
        np.testing.assert_allclose(found, along, rtol=1e-8, atol=1e-11 * np.abs(product).sum())


def with_parameter(scene, name, factor):
    """The scene with one of its parameters multiplied."""
    if name == "Lattice.mass":
        return scene.replace(lattice=replace(scene.lattice, mass=scene.lattice.mass * factor))
    kind, field = name.split(".")
    (old,) = (effect for effect in scene.effects if type(effect).__name__ == kind)
    value = getattr(old, field)
    changed = tuple(entry * factor for entry in value) if isinstance(value, tuple) else value * factor
    return scene.adding(replace(old, **{field: changed}))


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_by_parameters_agree_with_differences(name):
    scene = SCENES[name]()
    rollout, inputs, dx, dv, _ = pushed(scene, 1)
    inputs["wind"] = None
    loss(rollout, inputs, dx, dv)
    gradient = rollout.pull_back(dx, dv)
    assert set(gradient.parameters) == set(rollout.parameters)
    assert "Lattice.mass" in gradient.parameters
    for parameter, by in gradient.parameters.items():
        kind, field = parameter.split(".")
        owner = scene.lattice if kind == "Lattice" else next(e for e in scene.effects if type(e).__name__ == kind)
        value = np.asarray(getattr(owner, field))
        along = slope(lambda h: loss(Rollout(with_parameter(scene, parameter, 1 + 0.01 * h), 1), inputs, dx, dv) / 0.01)  # noqa: B023
        np.testing.assert_allclose((by * value).sum(), along[0], rtol=1e-8, atol=1e-10, err_msg=parameter)


def test_amplitudes_given_and_masses_go_together():
    scene = one_layer()
    rollout, inputs, dx, dv, _ = pushed(scene, 1)
    loss(rollout, inputs, dx, dv)
    gradient = rollout.pull_back(dx, dv)
    assert "CosineWind.amplitude" not in gradient.parameters
    along = slope(lambda h: loss(Rollout(with_parameter(scene, "Lattice.mass", 1 + 0.01 * h), 1), inputs, dx, dv) / 0.01)
    np.testing.assert_allclose(gradient.parameters["Lattice.mass"] * scene.lattice.mass, along, rtol=1e-8)


METHODS = {
    "LFAB": integrators.LFAB(), "Leapfrog": integrators.Leapfrog(), "half kick": integrators.Leapfrog("half_kick"),
    "Strang": integrators.Strang(), "RK4": integrators.RK4(),
}  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
def test_adjoint_identity_on_a_linear_rope(method):
    """A rope's motion is linear: (J u).w is known without differences, and equals u.(J' w) to round-off."""
    scene = presets.rope(9, integrator=METHODS[method], timestep=5e-4)
    rollout, rng = Rollout(scene, copies=1), np.random.default_rng(2)
    shape, held, free = (1, 1, 1, 9, 3), np.array([0.0, 0.0, 1.0]), ~scene.lattice.fixed.reshape(1, 1, 1, 9, 1)
    rest = scene.lattice.rest_positions
    u_x, u_v = held * rng.standard_normal(shape), 100 * held * free * rng.standard_normal(shape)
    w_x, w_v = held * rng.standard_normal(shape), 1e-3 * held * rng.standard_normal(shape)
    end = rollout.run(seconds=0.05, positions=rest + u_x, velocities=u_v) - rest
    there = (end * w_x).sum() + (rollout.velocities * w_v).sum()
    gradient = rollout.pull_back(w_x, w_v)
    back = (gradient.positions * u_x).sum() + (gradient.velocities * u_v).sum()
    scale = np.linalg.norm(end) * np.linalg.norm(w_x) + np.linalg.norm(rollout.velocities) * np.linalg.norm(w_v)
    assert abs(there - back) < 1e-13 * scale


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("copies", [1, 3])
def test_forward_bits_are_those_of_the_simulator(dtype, copies):
    scene = one_layer(dtype=dtype)
    rollout, inputs, *_ = pushed(scene, copies)
    end = rollout.run(seconds=0.061, **inputs)
    simulator = Simulator(scene, copies)
    simulator.set_positions(inputs["positions"])
    simulator.set_velocities(inputs["velocities"])
    for step, (amplitude, pose) in enumerate(zip(inputs["wind"], inputs["mast"], strict=True)):
        simulator.set_wind(amplitude=amplitude)
        simulator.set_mast(pose[:, :3], pose[:, 3:5], pose[:, 5])
        simulator.advance(0.061 / ACTIONS)
        np.testing.assert_array_equal(rollout.path[step], simulator.positions)
    np.testing.assert_array_equal(end, simulator.positions)
    np.testing.assert_array_equal(rollout.velocities, simulator.velocities)


def test_checkpoints_and_threads_change_no_bit():
    scene = one_layer()
    _, inputs, dx, dv, _ = pushed(scene, 5)
    found = []
    for memory, threads in ((1e9, 1), (1e9, 2), (1.0, 1), (2e5, 2)):
        rollout = Rollout(scene, 5, threads=threads, memory=memory)
        end = rollout.run(seconds=0.6, **inputs)
        first, again = rollout.pull_back(dx, dv), rollout.pull_back(dx, dv)
        for gradient in (first, again):
            parts = (gradient.wind, gradient.mast, gradient.positions, gradient.velocities, *gradient.parameters.values())
            found.append([end, *parts])
    for other in found[1:]:
        for one, two in zip(found[0], other, strict=True):
            np.testing.assert_allclose(two, one, rtol=1e-13, atol=0 if one is found[0][0] else 1e-14 * np.abs(one).max())


def test_copies_and_path_add_up():
    """Each copy by itself, and a loss on every action's end as the sum of losses on each."""
    scene = one_layer()
    rollout, inputs, dx, _, _ = pushed(scene, 2)
    rollout.run(seconds=SECONDS, **inputs)
    rng = np.random.default_rng(4)
    dpath = rng.standard_normal(rollout.path.shape)
    whole = rollout.pull_back(dpath)
    single = Rollout(scene, 1)
    total = np.zeros((ACTIONS, 3))
    for action in range(ACTIONS):
        part = {name: value[: action + 1, 1:] for name, value in inputs.items() if name in ("wind", "mast")}
        single.run(
            seconds=SECONDS * (action + 1) / ACTIONS, positions=inputs["positions"][1], velocities=inputs["velocities"][1], **part
        )
        total[: action + 1] += single.pull_back(dpath[action, 1:]).wind[:, 0]
    np.testing.assert_allclose(whole.wind[:, 1], total, rtol=1e-11, atol=1e-13 * np.abs(total).max())
    assert dx.shape == whole.positions.shape


def test_float32_follows_float64():
    results = []
    for dtype in ("float64", "float32"):
        rollout, inputs, dx, dv, _ = pushed(one_layer(dtype=dtype), 2)
        loss(rollout, inputs, dx, dv)
        gradient = rollout.pull_back(dx, dv)
        results.append([gradient.wind, gradient.mast, gradient.positions, gradient.velocities, *gradient.parameters.values()])
    for exact, rounded in zip(*results, strict=True):
        assert np.linalg.norm(rounded - exact) < 1e-3 * np.linalg.norm(exact)


def test_a_start_in_mid_motion_goes_on():
    scene = one_layer()
    simulator = Simulator(scene)
    simulator.set_wind(amplitude=(0.1, 0.2, 0.1))
    simulator.step(25)
    rollout = Rollout(scene)
    rollout.start = simulator.get_state()
    end = rollout.run(seconds=0.1)
    simulator.advance(0.1)
    np.testing.assert_array_equal(end, simulator.positions)
    np.testing.assert_array_equal(rollout.run(seconds=0.1), end)


@pytest.mark.parametrize(
    ("effect", "name"),
    [
        (effects.SelfCollision(), "SelfCollision"), (effects.StrainLimit(), "StrainLimit"), (effects.Tearing(0.5), "Tearing"),
        (effects.MastCollision(0.01), "MastCollision"), (effects.AirPressure(gusts=effects.Gusts()), "AirPressure"),
    ],
)  # fmt: skip
def test_what_is_not_smooth_is_refused_by_name(effect, name):
    with pytest.raises(ValueError, match=f"effects with a derivative for gradients; .*{name}"):
        Rollout(presets.flag(rows=4, cols=5, integrator=integrators.LFAB()).adding(effect))


def test_methods_without_a_way_back_are_refused():
    for method in (integrators.Implicit(), integrators.ExplicitEuler(), integrators.Strang(iterations=2)):
        with pytest.raises(ValueError, match="integrator with a way back"):
            Rollout(presets.flag(rows=4, cols=5, integrator=method))


def test_bad_arguments_are_told():
    rollout = Rollout(one_layer())
    with pytest.raises(RuntimeError, match="run must have been called"):
        rollout.pull_back(np.zeros((1, 1, 4, 5, 3)))
    for keywords, message in (
        ({"wind": np.zeros((2, 3, 3))}, "wind must"),
        ({"mast": np.zeros((2, 1, 4))}, "mast must"),
        ({"wind": np.zeros((2, 1, 3)), "mast": np.zeros((3, 1, 5))}, "same number of actions"),
        ({"wind": np.zeros((99, 1, 3)), "seconds": 0.01}, "seconds must give each of 99 actions a step"),
    ):
        with pytest.raises(ValueError, match=message):
            rollout.run(**keywords)
    with pytest.raises(ValueError, match=r"parameters must be some of Gravity.acceleration.*, got \('Shear.colour',\)"):
        Rollout(one_layer(), parameters=("Shear.colour",))
    with pytest.raises(ValueError, match="scene must hold a wind"):
        Rollout(one_layer().without(effects.CosineWind)).run(wind=np.zeros((1, 1, 3)))
    rollout.run(seconds=0.1)
    with pytest.raises(ValueError, match="dL_dx"):
        rollout.pull_back(np.zeros((1, 1, 4, 4, 3)))


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    rows=st.integers(1, 4), cols=st.integers(2, 6), pinned=st.sampled_from(["edge", "sleeve", "ends", "none"]),
    taper=st.floats(0.1, 2.0), stiffness=st.floats(10.0, 300.0), share=st.floats(0.02, 1.0), seed=st.integers(0, 2**31),
)  # fmt: skip
def test_random_scenes(rows, cols, pinned, taper, stiffness, share, seed):
    """Whatever is put together of effects that are compiled once."""
    lattice = Lattice(1, rows, cols, 0.1, 1e-2, taper, pinned)
    damping = share * np.sqrt(stiffness * 1e-2)
    acting = (
        effects.Gravity(), effects.Structural(stiffness, damping), effects.AirDrag(share),
        effects.CosineWind((0.01,) * 3, (5.0,) * 3),
    )  # fmt: skip
    scene = Scene(lattice, acting, integrators.LFAB(), perturbation=0.01)
    rollout, rng = Rollout(scene, parameters=("Structural.stiffness",)), np.random.default_rng(seed)
    wind, w = 0.05 * rng.standard_normal((2, 1, 3)), rng.standard_normal((1, *lattice.shape, 3))
    seconds = min(40 * rollout.timestep, 0.15)  # differences see no further where motion is wild
    rollout.run(wind=wind, seconds=seconds)
    gradient = rollout.pull_back(w)
    u = 3e-4 * rng.standard_normal(wind.shape)
    along = slope(lambda h: (rollout.run(wind=wind + h * u, seconds=seconds) * w).sum())
    np.testing.assert_allclose((gradient.wind * u).sum(), along, rtol=1e-8, atol=1e-10 * np.abs(gradient.wind * u).sum() + 1e-14)
