"""Step limits are safe in every pose and sharp within 1 %: spectral radii of a step, over light to heavy damping."""

import dataclasses
import math
from itertools import product

import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, max_timestep
from flag_env.physics.effects import AirDrag, Bending, Structural, Tearing
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Implicit, Leapfrog, Strang
from flag_env.physics.integrators.rk4 import BULGE, SAG
from flag_env.physics.limits.spectrum import SceneSpectrum

METHODS = [ExplicitEuler(), Leapfrog(), Leapfrog("half_kick"), LFAB(), Strang(), RK4(), Implicit()]
K, M, FREE = 80.0, 0.5, 5
FASTEST = 2 * math.sqrt(K / M) * math.sin(FREE * math.pi / 12)
"""Of the chain's modes [1/s]."""

RATIOS = (0.0, *np.geomspace(0.02, 30, 21))
"""Damping of the fastest mode over its critical damping."""


def chain(ratio, damper, method=LFAB()):  # noqa: B008  (immutable)
    """A rope: exactly M x'' + Z x' + K x = 0."""
    rate = 2 * ratio * FASTEST
    effects = (Structural(K, M * rate * K / (M * FASTEST**2)),) if damper == "links" else (Structural(K, 0.0), AirDrag(rate))
    return Scene(Lattice(1, 1, FREE + 2, 1.0, M, pinned="ends", dimensions=1), effects, method, allow_unstable=True)


def spectral_radius(scene, timestep, softer):
    """Of one step of the simulator as it is, with the stiffness multiplied by `softer`: a pose that is less stiff."""
    rows = int(isinstance(scene.integrator, LFAB))  # of memory
    size = (2 + rows) * FREE
    simulator = Simulator(scene.scaled(stiffness=softer).replace(timestep=timestep), copies=size)
    simulator.step(1)
    state = simulator.get_state()
    inner = slice(1, FREE + 1)
    unit = np.eye(size).reshape(size, 2 + rows, FREE)
    arrays = {name: np.zeros_like(getattr(state, name)) for name in ("positions", "velocities", "history")}
    arrays["positions"][:, 0, inner], arrays["velocities"][:, 0, inner] = unit[:, 0], unit[:, 1]
    arrays["history"][:, :, 0, inner] = unit[:, 2:]
    simulator.set_state(dataclasses.replace(state, **arrays))
    simulator.step(1)
    end = simulator.get_state()
    columns = [end.positions[:, 0, inner], end.velocities[:, 0, inner], *np.moveaxis(end.history[:, :, 0, inner], 1, 0)]
    return np.abs(np.linalg.eigvals(np.concatenate(columns, axis=1))).max()


@pytest.mark.parametrize("damper", ["links", "drag"])
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_limit_is_safe_and_within_one_percent_at_every_damping(method, damper):
    for ratio in RATIOS:
        scene = chain(ratio, damper, method)
        limit = max_timestep(scene)
        if isinstance(method, Implicit):
            assert limit >= 9.98 * max_timestep(chain(0, damper, Strang()))
            continue
        if isinstance(method, ExplicitEuler) and ratio == 0:
            assert limit == 0.0
            continue
        poses = (0.02, 0.4, 0.8, 1.0)
        assert max(spectral_radius(scene, 0.9999 * limit, softer) for softer in poses) <= 1 + 1e-9, ratio
        assert max(spectral_radius(scene, 1.01 * limit, softer) for softer in (0.0, 1.0)) > 1 + 1e-7, ratio


def amplification(method, k, z, h):
    """One step of explicit Euler or of the Runge-Kutta scheme for x'' + z x' + k x = 0, written from the methods' definitions."""
    n = len(k)
    slope = h * np.block([[np.zeros((n, n)), np.eye(n)], [-k, -z]])
    terms = [np.eye(2 * n)]
    for order in range(1, method.order + 1):
        terms.append(terms[-1] @ slope / order)
    return sum(terms)


def test_what_the_runge_kutta_scheme_allows_is_filled():
    """Along any ratio of damping to frequency, from 1e-3 to 10, the step is safe in softer poses, and 1 % more is not."""

    def stable(a, b):
        root = np.sqrt(b * b / 4 - a + 0j)
        z = np.stack([-b / 2 + root, -b / 2 - root])
        return np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24).max(axis=0) <= 1 + 1e-9

    softer = np.linspace(0, 1, 401)
    for c in (0.0, *np.geomspace(1e-3, 10, 600)):
        steps = {
            line: 2 * line[2] / (line[1] * c + math.sqrt((line[1] * c) ** 2 + 4 * line[0] * line[2]) or 1e-99)
            for line in BULGE + SAG
        }  # h where w = 1
        h = min(min(steps[line] for line in BULGE), max(steps[line] for line in SAG))
        assert stable(softer * h**2, np.full(401, h * c)).all(), c
        assert not stable(softer * (1.01 * h) ** 2, np.full(401, 1.01 * h * c)).all(), c


BRITTLE = {
    "one ratio": (Structural(K, 0.8), AirDrag(0.0)),
    "bare bending": (Structural(K, 0.8), Bending(0.4 * K, 0.0), AirDrag(1.5)),
    "damped bending": (Structural(K, 0.05), Bending(0.1 * K, 1.5), AirDrag(0.7)),
    "drag alone": (Structural(K, 0.0), Bending(0.1 * K, 0.0), AirDrag(2.0)),
}


@pytest.mark.parametrize("links", BRITTLE)
@pytest.mark.parametrize("method", [ExplicitEuler(), RK4()], ids=repr)
def test_damping_that_breaks_with_its_links_is_no_gain(method, links):
    """Whichever links are broken, all of them tried one by one, a step at the limit of a scene that tears amplifies nothing."""
    lattice = Lattice(1, 1, 6, 1.0, M, 0.4, pinned="ends")
    whole = Scene(lattice, BRITTLE[links], method)
    limit, careless = max_timestep(whole.adding(Tearing())), max_timestep(whole)
    assert limit <= careless
    share = 1 - 0.6 * np.arange(6) / 5
    pairs = []
    for effect in whole.effects:
        for start in range(6 - (span := {Structural: 1, Bending: 2, AirDrag: 6}[type(effect)])):
            pair = np.zeros(6)
            pair[[start, start + span]] = 1, -1
            pairs.append((effect.stiffness * np.outer(pair, pair), effect.viscosity * np.outer(pair, pair)))
    drag = np.diag(whole.effects[-1].rate * M * share)
    root = np.sqrt(M * share[1:-1])
    worst = {limit: 0.0, careless: 0.0}
    for chosen in product((0.0, 1.0), repeat=len(pairs)):
        k, z = (sum(c * pair[i] for c, pair in zip(chosen, pairs, strict=True)) for i in (0, 1))
        k, z = ((matrix[1:-1, 1:-1] / np.outer(root, root)) for matrix in (k, z + drag))
        for h in worst:
            radius = np.abs(np.linalg.eigvals(amplification(method, k, z, h))).max()
            worst[h] = max(worst[h], radius)
    assert worst[limit] <= 1 + 1e-6  # broken loose, a particle has two roots at 1
    if links in ("bare bending", "damped bending") and isinstance(method, ExplicitEuler):
        assert limit < 0.99 * careless
        assert worst[careless] > 1 + 1e-6


@pytest.mark.parametrize("damping", ["isotropic", "axial"])
def test_limit_of_rk4_is_safe_where_stiffness_and_damping_share_no_modes(damping):
    lattice = Lattice(1, 3, 4, (0.1, 0.12), 0.02, 0.4)
    links = (Structural(12.0, 0.15, damping), Bending(5.0, 0.0, damping, tapered=True), AirDrag(0.8))
    h = max_timestep(Scene(lattice, links, RK4()))
    spectra = [SceneSpectrum(lattice, effects) for effects in (links, links[-1:])]
    for stiff in (1.0, 0.5, 0.0):
        for z in (spectrum.damping for spectrum in (spectra[:1] if damping == "isotropic" else spectra)):
            step = amplification(RK4(), stiff * spectra[0].stiffness.toarray(), z.toarray(), h)
            assert np.abs(np.linalg.eigvals(step)).max() <= 1 + 1e-9
