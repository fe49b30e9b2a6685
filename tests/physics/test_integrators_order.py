"""Every integrator's error falls as its declared order has it, against an independent solution."""

from itertools import pairwise

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator
from flag_env.physics.effects import AirDrag, CosineWind, Gravity, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Implicit, Leapfrog, Strang
from flag_env.studies import reference

METHODS = [  # a new integrator joins with one line
    ExplicitEuler(),
    Leapfrog(),
    Leapfrog("half_kick"),
    LFAB(),
    Strang(),
    RK4(),
    Implicit(),
]
REVERSIBLE = [Leapfrog("half_kick"), LFAB(), Strang()]

every_method = pytest.mark.parametrize("method", METHODS, ids=repr)


# -- a smooth scene, whose solution comes from `studies.reference` --------------------------------------------------

DAMPING = {
    "none": (0.0, "isotropic", 0.0),
    "isotropic": (0.15, "isotropic", 0.8),
    "axial": (0.15, "axial", 0.8),
}  # viscosity, kind, drag
END = 0.4
MAST = np.array([0.05, -0.08, 0.1])


def smooth(damping, method=LFAB(), **changes):  # noqa: B008  (immutable)
    viscosity, kind, drag = DAMPING[damping]
    lattice = Lattice(1, 3, 4, (0.1, 0.12), 0.02, 0.4)
    effects = (
        Gravity(),
        Structural(12.0, viscosity, kind),
        Shear(5.0, 0.5 * viscosity, kind, tapered=True),
        AirDrag(drag),
        CosineWind((0.05, 0.1, 0.04), (5.0, 7.0, 3.0), (0.02, 0.0, 0.05), (0.3, 0.0, 1.0)),
    )
    return Scene(lattice, effects, method, allow_unstable=True, **{"timestep": END / 256, **changes})


def beginning(scene):
    """Positions and velocities, (layers, rows, cols, 3): stretched, bulging and moving."""
    random = np.random.default_rng(2)
    rest = scene.lattice.rest_positions
    x = 1.1 * rest + 0.02 * random.standard_normal(rest.shape)
    v = 0.3 * random.standard_normal(rest.shape)
    x[:, :, 0], v[:, :, 0] = rest[:, :, 0], 0.0
    return x, v


@pytest.fixture(scope="module")
def solution():
    """Free particles' positions and velocities at `END`, by kind of damping."""
    found = {}
    for damping in DAMPING:
        x, v = beginning(smooth(damping))
        v[:, :, 0] = MAST / END
        end = reference.solve(smooth(damping), [END], x, v)
        found[damping] = np.concatenate([end.positions, end.velocities])[:, 0, :, 1:]
    return found


def run(scene, steps=None):
    sim = Simulator(scene)
    x, v = beginning(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.set_mast(MAST)
    sim.step(round(END / scene.timestep) if steps is None else steps)
    return sim


ORDERS = [
    *((method, "isotropic", method.order) for method in METHODS),
    (Leapfrog("half_kick"), "none", 2),
    (Strang(), "axial", 1),
    (Strang(2), "axial", 2),
    (Implicit(4), "axial", 2),
    (Implicit(1), "isotropic", 2),
    (Implicit(5), "isotropic", 2),
]


@pytest.mark.parametrize(("method", "damping", "order"), ORDERS, ids=str)
def test_error_falls_with_the_step_as_declared(method, damping, order, solution):
    steps = {1: (1024, 2048, 4096, 8192), 2: (512, 1024, 2048, 4096), 4: (64, 128, 256, 512)}[order]
    ends, errors = [], []
    for n in steps:
        sim = run(smooth(damping, method, timestep=END / n))
        ends.append(np.stack([sim.positions[0, 0, :, 1:], sim.velocities[0, 0, :, 1:]]))
        errors.append(np.sqrt(((ends[-1] - solution[damping]) ** 2).mean(axis=(1, 2, 3))))
    for quantity in np.transpose(errors):
        slope = -np.polyfit(np.log(steps), np.log(quantity), 1)[0]
        assert slope == pytest.approx(order, abs=0.15)
        assert quantity[-1] < 3e-3
    changes = [np.abs(b - a).max() for a, b in pairwise(ends)]
    assert changes[-2] / changes[-1] == pytest.approx(2**order, rel=0.1)  # Richardson


def test_orders_are_declared():
    assert {type(method).__name__: method.order for method in METHODS} == {
        "ExplicitEuler": 1, "Leapfrog": 1, "LFAB": 2, "Strang": 2, "RK4": 4, "Implicit": 2,
    }  # fmt: skip
