"""How sharp the step limit is: random flags in wind, just below their limit and above it until they blow up.

Each timestep is tried from two starts. *Flung*: every particle some hundred spacings away from its place, so that all links are
long and point anywhere. *Shaken*: at rest, with random velocities. A link at its rest length resists along itself only, a long
one nearly alike every way, which is what a limit for every pose has to allow for. So a shaken flag may bear a step above its
limit until it gets into a worse pose; a flung one is there already.
"""

from __future__ import annotations

import math

import numpy as np
from tqdm import tqdm

from flag_env.physics import Diverged, Lattice, Scene, Simulator, diagnostics, max_timestep
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Integrator, Leapfrog, Strang

METHODS: tuple[Integrator, ...] = (Leapfrog(), LFAB(), Strang(), RK4(), ExplicitEuler())
"""Integrators with a step limit."""

GUARANTEED = 0.95
"""Share of the limit at which no flag may blow up."""

HIGHEST = 1.5
"""No timestep above so many limits is tried."""

STEPS = 3000
SECONDS = 2.0
"""A run takes so many steps, and at least so many seconds."""

TORN = 10.0
"""Growth of the largest link length that makes a flag one that has blown up, or is about to."""

STARTS = {"flung": 100.0, "shaken": 0.0}
"""Standard deviation of the particles' displacement at the start, in spacings."""


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
    """Whether a flag of the scene in its wind is still a flag at the end of a run at this timestep, from every start."""
    return all(_survives(scene, timestep, flung) for flung in STARTS.values())


def _survives(scene: Scene, timestep: float, flung: float) -> bool:
    simulator = Simulator(scene.replace(timestep=timestep, allow_unstable=True))
    random, moving = np.random.default_rng(0), ~scene.lattice.fixed.reshape(*scene.lattice.shape, 1)
    simulator.set_velocities(np.where(moving, random.standard_normal(simulator.velocities.shape), 0.0))
    away = flung * scene.lattice.spacings[0] * random.standard_normal(simulator.positions.shape)
    simulator.set_positions(simulator.positions + np.where(moving, away, 0.0))
    longest = 1.0 + diagnostics.strain(scene.lattice, simulator.positions).max(initial=0.0)
    try:
        simulator.step(max(STEPS, math.ceil(SECONDS / timestep)))
    except Diverged:
        return False
    with np.errstate(over="ignore"):  # what grows beyond all bounds has no strain
        return bool(1.0 + diagnostics.strain(scene.lattice, simulator.positions).max(initial=0.0) < TORN * longest)


def blow_up(scene: Scene) -> float:
    """Smallest tried timestep at which the flag blows up, in units of its limit: from 1 up by steps of 2 % to `HIGHEST`."""
    limit, factor = max_timestep(scene), 1.0
    while factor < HIGHEST and survives(scene, factor * limit):
        factor *= 1.02
    return factor


def margins(method: Integrator, scenes: int, seed: int = 0) -> dict[str, float | int | str]:
    """A row: how many random scenes blow up at 0.95 of the limit, and where above it they do, up to `HIGHEST`."""
    lost, factors = 0, []
    for number in tqdm(range(scenes), desc=type(method).__name__, leave=False):
        scene = random_scene(np.random.default_rng((seed, number)), method)
        lost += not survives(scene, GUARANTEED * max_timestep(scene))
        factors.append(min(blow_up(scene), HIGHEST))
    return {
        "integrator": type(method).__name__,
        "scenes": scenes,
        "blow-ups at 0.95": lost,
        "blow-up, least": min(factors),
        "median": float(np.median(factors)),
        "largest": max(factors),
    }
