"""The step limit against closed forms, measured tables and the amplification matrix."""

import math
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
import pytest
import scipy.linalg

from flag_env.physics import Lattice, Simulator, max_timestep, presets
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, LinkEffect, Shear, Structural
from flag_env.physics.integrators import Leapfrog
from flag_env.physics.limits.certificate import MARGIN
from tests.physics.scenes import leapfrog_scene

DIRECTIONS = {  # independent of the effects' own lists
    Structural: [(0, 0, 1), (0, 1, 0)],
    Shear: [(0, 1, 1), (0, -1, 1)],
    Bending: [(0, 0, 2), (0, 2, 0)],
    CrossLayer: [(1, 0, 0), *((1, a, b) for a in (-1, 1) for b in (-1, 1))],
}


def just_below(sharp, digits=0.0):
    """What a proven limit may be: at most so much of itself below the sharp one as is left open, never above.

    `digits` is the relative error of a sharp limit that is known to some digits only.
    """
    return pytest.approx((1 - MARGIN) * sharp, rel=0.0, abs=(MARGIN + max(digits, 1e-9)) * sharp)


def chain(cols, **scene):
    return leapfrog_scene(Lattice(1, 1, cols, 0.1, 0.01), (Structural(500.0, 0.0),), **scene)


# -- closed forms and tables -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("zeta", "known"), [(0.0, 2.0), (0.1, 1.8100), (0.5, 1.2361), (1.0, 0.8284), (10.0, 0.09975)])
def test_limit_of_one_oscillator(zeta, known):
    k, m = 350.0, 0.02
    scene = leapfrog_scene(Lattice(1, 1, 2, 0.1, m), (Structural(k, 2 * zeta * math.sqrt(k * m)),))
    reduced = max_timestep(scene) * math.sqrt(k / m)
    assert reduced == pytest.approx(2 * (math.sqrt(1 + zeta**2) - zeta), rel=1e-9)
    assert reduced == pytest.approx(known, rel=5e-5)


def test_limit_of_damping_alone():
    lattice = Lattice(1, 1, 2, 0.1, 0.02)
    assert max_timestep(leapfrog_scene(lattice, (AirDrag(8.0),))) == pytest.approx(2 / 8, rel=1e-9)
    assert max_timestep(leapfrog_scene(lattice, (Structural(0.0, 0.4),))) == pytest.approx(2 * 0.02 / 0.4, rel=1e-9)
    assert max_timestep(leapfrog_scene(lattice, (Structural(0.0, 0.4), AirDrag(8.0)))) == pytest.approx(2 / 28, rel=1e-9)


def test_nothing_limits_a_scene_without_links_and_damping():
    for scene in (
        leapfrog_scene(Lattice(), (Gravity(), CosineWind())),
        presets.flag(1, 1),
        leapfrog_scene(Lattice(1, 3, 3), (Structural(0.0, 0.0),)),
    ):
        assert max_timestep(scene) == math.inf
        assert 0 < Simulator(scene).timestep < math.inf


@pytest.mark.parametrize("cols", [2, 5, 40, 90])
def test_limit_of_a_chain(cols):
    free = cols - 1
    top = 2 * math.sqrt(500.0 / 0.01) * math.sin((2 * free - 1) * math.pi / (2 * (2 * free + 1)))  # clamped-free chain
    assert max_timestep(chain(cols)) == just_below(2 / top, 1e-9)


def measured(layers, taper, damped, **links):
    """The scene of the table of measured limits: damping is 2e-4 s times stiffness."""
    z = 2e-4 if damped else 0.0
    effects = (Structural(500.0, 500 * z, **links), Shear(250.0, 250 * z, **links), Bending(50.0, 50 * z, **links))
    return leapfrog_scene(Lattice(layers, 20, 32, 0.05, 1e-3, taper), effects)


@pytest.mark.parametrize(
    ("taper", "damped", "undamped"), [(1.0, 7.972e-4, 9.769e-4), (0.1, 2.094e-4, 3.573e-4), (0.01, 3.054e-5, 1.147e-4)]
)
def test_limits_measured_for_one_layer(taper, damped, undamped):
    assert max_timestep(measured(1, taper, True)) == just_below(damped, 5e-4)  # four digits
    assert max_timestep(measured(1, taper, False)) == just_below(undamped, 5e-4)


@dataclass(frozen=True)
class Struts(LinkEffect):
    directions: ClassVar = ((1, 0, 0),)


@dataclass(frozen=True)
class CubeDiagonals(LinkEffect):
    directions: ClassVar = ((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1), (1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1))


def test_limits_measured_for_two_layers():
    """The table's second layer is joined by struts as stiff as structural links, face and space diagonals as stiff as shear."""
    damped = measured(2, 0.1, True).adding(Struts(500.0, 0.1), CubeDiagonals(250.0, 0.05))
    assert max_timestep(damped) == just_below(1.416e-4, 4e-4)
    assert max_timestep(damped.scaled(viscosity=0.0)) == just_below(2.770e-4, 2e-4)


def test_tapering_the_links_with_the_mass_costs_no_step():
    assert max_timestep(measured(1, 0.1, True, tapered=True)) == just_below(7.971e-4, 2e-4)


# -- the amplification matrix ------------------------------------------------------------------------------------------------


def random_scene(random, large=False):
    layers, rows, cols = (2, 5, 8) if large else (int(n) for n in random.integers((1, 1, 2), (3, 5, 6)))
    mass = 10 ** random.uniform(-3, 0)
    pinned = str(random.choice(["edge", "ends", "none"] if cols > 2 else ["edge", "none"]))
    lattice = Lattice(layers, rows, cols, 0.1, mass, random.uniform(0.05, 1.5), pinned)
    effects = []
    for kind in DIRECTIONS:
        if kind is Structural or random.random() < 0.7:
            k = mass * 10 ** random.uniform(3, 5)
            z = random.choice([0.0, random.uniform(0, 2) * math.sqrt(k * mass)])
            effects.append(kind(k, z, str(random.choice(["isotropic", "axial"])), tapered=bool(random.random() < 0.5)))
    if random.random() < 0.5:
        effects.append(AirDrag(random.uniform(0, 5)))
    return leapfrog_scene(lattice, tuple(effects))


def spectral_radius(scene, h):
    """Of the linear scheme (w, x) -> (w', x + h w'), w' = (1 - h Z) w - h K x, links enumerated one by one."""
    lattice = scene.lattice
    number = {p: i for i, p in enumerate(product(*map(range, lattice.shape)))}
    share = np.array([1 - (1 - lattice.taper) * col / max(lattice.cols - 1, 1) for _, _, col in number])
    K, Z = np.zeros((2, len(number), len(number)))
    for effect in scene.effects:
        if isinstance(effect, AirDrag):
            Z += np.diag(effect.rate * lattice.mass * share)
            continue
        for (p, i), step in product(number.items(), DIRECTIONS[type(effect)]):
            j = number.get(tuple(np.add(p, step)))
            if j is not None:
                pair = np.zeros(len(number))
                pair[[i, j]] = 1, -1
                weight = (share[i] + share[j]) / 2 if effect.tapered else 1.0
                K += effect.stiffness * weight * np.outer(pair, pair)
                Z += effect.viscosity * weight * np.outer(pair, pair)
    last = lattice.cols - 1
    free = [
        i
        for (_, _, col), i in number.items()
        if lattice.pinned == "none" or (col > 0 and not (lattice.pinned == "ends" and col == last))
    ]
    mass = lattice.mass * share[free, None]
    K, Z = K[np.ix_(free, free)] / mass, Z[np.ix_(free, free)] / mass
    one = np.eye(len(free))
    matrix = np.block([[one - h * Z, -h * K], [h * (one - h * Z), one - h * h * K]])
    return np.abs(scipy.linalg.eigvals(matrix)).max()


@pytest.mark.parametrize("seed", range(14))
def test_limit_is_where_the_linear_scheme_starts_to_grow(seed):
    scene = random_scene(np.random.default_rng(seed), large=seed >= 12)
    limit = max_timestep(scene)
    assert spectral_radius(scene, limit) < 1 + 1e-7
    assert spectral_radius(scene, limit * (1 + 2.5 * MARGIN)) > 1 + 1e-7


@pytest.mark.parametrize(("rows", "cols"), [(2, 2), (3, 2), (3, 3), (2, 3), (1, 3), (4, 2)])
def test_directions_may_share_an_offset_on_narrow_lattices(rows, cols):
    scene = presets.flag(rows, cols, integrator=Leapfrog()).without(Gravity, CosineWind)
    limit = max_timestep(scene)
    assert spectral_radius(scene, limit) < 1 + 1e-7
    assert spectral_radius(scene, limit * (1 + 2.5 * MARGIN)) > 1 + 1e-7
