"""How sharp the step limit is: random flags in wind, just below their limit and above it until they blow up."""

from __future__ import annotations

import math

import numpy as np

from flag_env.physics import Diverged, Lattice, Scene, Simulator, diagnostics, max_timestep
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Leapfrog, Strang
from flag_env.physics.integrators.base import Integrator

METHODS: tuple[Integrator, ...] = (Leapfrog(), LFAB(), Strang(), RK4(), ExplicitEuler())
"""Integrators with a step limit."""

GUARANTEED = 0.95
"""Share of the limit at which no flag may blow up."""

STEPS = 3000
SECONDS = 2.0
"""A run takes so many steps, and at least so many seconds."""

TORN = 10.0
"""A link that is so many times longer than at rest belongs to a flag that has blown up, or is about to."""


def random_scene(random: np.random.Generator, method: Integrator) -> Scene:
    """A flag with links of any stiffness and damping, taper, layers, clamping, drag and wind; the classes are always the same,
    so that one compiled step per method serves all of them.
    """
    layers, rows, cols = (int(n) for n in random.integers((1, 2, 3), (3, 7, 9)))
    mass, taper = 10 ** random.uniform(-3, -1), random.uniform(0.02, 1.5)
    lattice = Lattice(
        layers, rows, cols, (0.1, 0.1 * random.uniform(0.5, 2)), mass, taper, str(random.choice(["edge", "sleeve"]))
    )
    tapered = bool(random.random() < 0.5)
    links = []
    for kind in (Structural, Shear, Bending, CrossLayer):
        stiffness = mass * 10 ** random.uniform(3.5, 5.0)
        links.append(kind(stiffness, 10 ** random.uniform(-2.5, 0.7) * math.sqrt(stiffness * mass), tapered=tapered))
    push = mass * min(taper, 1.0) * random.uniform(-40, 40, 3)
    wind = CosineWind(tuple(push), tuple(random.uniform(1, 30, 3)), tuple(push[::-1] / 3))
    return Scene(lattice, (Gravity(), *links, AirDrag(random.uniform(0, 5)), wind), method, perturbation=1e-3)


def survives(scene: Scene, timestep: float) -> bool:
    """Whether a flag of the scene, shaken and in its wind, is still a flag at the end of a run at this timestep."""
    simulator = Simulator(scene.replace(timestep=timestep, allow_unstable=True))
    velocities = np.random.default_rng(0).standard_normal(simulator.velocities.shape)
    simulator.set_velocities(np.where(scene.lattice.fixed.reshape(scene.lattice.shape)[..., None], 0.0, velocities))
    try:
        simulator.step(max(STEPS, math.ceil(SECONDS / timestep)))
    except Diverged:
        return False
    with np.errstate(over="ignore"):  # what grows beyond all bounds has no strain
        return bool(diagnostics.strain(scene.lattice, simulator.positions).max(initial=0.0) < TORN)


def blow_up(scene: Scene) -> float:
    """Smallest tried timestep at which the flag blows up, in units of its limit: from 1 up by steps of 2 % to 3."""
    limit, factor = max_timestep(scene), 1.0
    while factor < 3.0 and survives(scene, factor * limit):
        factor *= 1.02
    return factor


def margins(method: Integrator, scenes: int, seed: int = 0) -> dict[str, float | int | str]:
    """A row: how many random scenes blow up at 0.95 of the limit, and where above it they do."""
    made = [random_scene(np.random.default_rng((seed, number)), method) for number in range(scenes)]
    lost = sum(not survives(scene, GUARANTEED * max_timestep(scene)) for scene in made)
    factors = np.array([blow_up(scene) for scene in made])
    return {
        "integrator": type(method).__name__,
        "scenes": scenes,
        "blow-ups at 0.95": lost,
        "blow-up, least": float(factors.min()),
        "median": float(np.median(factors)),
        "largest": float(factors.max()),
    }
