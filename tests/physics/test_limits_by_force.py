"""Step limits against brute force: links one by one, in three dimensions, in random poses, some of them broken."""

import math
from itertools import product

import numpy as np
import pytest
import scipy.sparse

from flag_env.physics import Lattice, Scene, max_timestep, presets
from flag_env.physics.effects import AirDrag, AirPressure, Bending, CrossLayer, Shear, Structural, Tearing
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Leapfrog, Strang, positive_root
from flag_env.physics.limits import SceneSpectrum, certificate
from flag_env.physics.limits.certificate import MARGIN, Pencil, factor
from flag_env.physics.limits.operators import Matrices
from flag_env.physics.limits.terms import Terms

DIRECTIONS = {  # independent of the effects' own lists
    Structural: [(0, 0, 1), (0, 1, 0)],
    Shear: [(0, 1, 1), (0, -1, 1)],
    Bending: [(0, 0, 2), (0, 2, 0)],
    CrossLayer: [(1, 0, 0), *((1, a, b) for a in (-1, 1) for b in (-1, 1))],
}
METHODS = (Leapfrog(), LFAB(), Strang(), RK4(), ExplicitEuler())


def random_scene(random):
    layers, rows, cols = (int(n) for n in random.integers((1, 1, 2), (3, 4, 5)))
    mass = 10 ** random.uniform(-4, 0)
    pinned = str(random.choice(["edge", "ends", "none", "sleeve"] if cols > 2 else ["edge", "none"]))
    lattice = Lattice(layers, rows, cols, 0.1, mass, 10 ** random.uniform(-3, 0.3), pinned)
    effects, ratio = [], 10 ** random.uniform(-3, 1.5)
    for kind in DIRECTIONS:
        if kind is Structural or random.random() < 0.7:
            k = mass * 10 ** random.uniform(2, 6) * (random.random() < 0.9)
            z = ratio * 10 ** random.uniform(-1, 1) * math.sqrt(max(k, 1e3 * mass) * mass) * (random.random() < 0.8)
            damping = str(random.choice(["isotropic", "axial"], p=[0.7, 0.3]))
            effects.append(kind(k, z, damping, tapered=bool(random.random() < 0.5)))
    if random.random() < 0.6:
        effects.append(AirDrag(10 ** random.uniform(-2, 3)))
    if random.random() < 0.5:
        effects.append(Tearing(0.5))
    return Scene(lattice, tuple(effects))


def links_of(scene):
    """Rows (i, j, k, z, isotropic)."""
    lattice = scene.lattice
    number = {p: i for i, p in enumerate(product(*map(range, lattice.shape)))}
    share = np.array([1 - (1 - lattice.taper) * col / max(lattice.cols - 1, 1) for *_, col in number])
    links = []
    for effect in scene.effects:
        for (p, i), step in product(number.items(), DIRECTIONS.get(type(effect), ())):
            j = number.get(tuple(np.add(p, step)))
            if j is not None:
                weight = (share[i] + share[j]) / 2 if effect.tapered else 1.0
                links.append((i, j, effect.stiffness * weight, effect.viscosity * weight, effect.damping == "isotropic"))
    column = np.array([col for *_, col in number])
    last = lattice.cols - 1
    pinned = {"none": column < 0, "edge": column == 0, "ends": (column == 0) | (column == last), "sleeve": column < 2}
    return links, lattice.mass * share, ~pinned[lattice.pinned]


def matrices(scene, random, softness, share_broken):
    """Mass-scaled K and Z of a pose: every link points anywhere and has any l/d >= 0, drawn by `softness`."""
    links, masses, free = links_of(scene)
    rate = sum(effect.rate for effect in scene.effects if isinstance(effect, AirDrag))
    k_all, z_all = np.zeros((2, 3 * len(masses), 3 * len(masses)))
    z_all += np.diag(np.repeat(rate * masses, 3))
    for i, j, k, z, isotropic in links:
        if random.random() < share_broken:
            continue
        along = random.standard_normal(3)
        along /= np.linalg.norm(along)
        across = 1.0 - random.random() ** softness if softness else 1.0  # 1 - l/d
        blocks = (
            k * (across * np.eye(3) + (1 - across) * np.outer(along, along)),
            z * np.eye(3) if isotropic else (z * np.outer(along, along)),
        )
        here, there = slice(3 * i, 3 * i + 3), slice(3 * j, 3 * j + 3)
        for matrix, block in zip((k_all, z_all), blocks, strict=True):
            matrix[here, here] += block
            matrix[there, there] += block
            matrix[here, there] -= block
            matrix[there, here] -= block
    moving, root_mass = np.repeat(free, 3), np.sqrt(np.repeat(masses[free], 3))
    return [matrix[np.ix_(moving, moving)] / np.outer(root_mass, root_mass) for matrix in (k_all, z_all)]


def spectral_radius(method, k, z, h):
    """Of one step, from the methods' definitions."""
    one, nothing = np.eye(len(k)), np.zeros_like(k)
    if isinstance(method, Leapfrog):
        step = np.block([[one - h * z, -h * k], [h * (one - h * z), one - h * h * k]])
    elif isinstance(method, LFAB):
        kick = [one - 1.5 * h * z, 0.5 * h * z, -h * k]
        step = np.block([kick, [one, nothing, nothing], [h * kick[0], h * kick[1], one + h * kick[2]]])
    elif isinstance(method, Strang):
        solved = np.linalg.inv(one + 0.5 * h * z)
        drift = np.block([[one, nothing], [0.5 * h * one, one]])
        step = drift @ np.block([[solved @ (one - 0.5 * h * z), -h * solved @ k], [nothing, one]]) @ drift
    else:
        slope, term = h * np.block([[-z, -k], [one, nothing]]), np.eye(2 * len(k))
        step = term
        for order in range(1, method.order + 1):
            term = term @ slope / order
            step = step + term
    return np.abs(np.linalg.eigvals(step)).max()


@pytest.mark.parametrize("seed", range(16))
def test_no_pose_grows_at_the_limit_whichever_links_are_broken(seed):
    random = np.random.default_rng((77, seed))
    scene = random_scene(random)
    tears = any(isinstance(effect, Tearing) for effect in scene.effects)
    poses = [matrices(scene, random, softness, 0.0) for softness in (0.0, 0.2, 1.0, 4.0)]
    if tears:
        poses += [matrices(scene, random, softness, broken) for softness in (0.0, 1.0) for broken in (0.1, 0.4, 0.7)]
    for method in METHODS:
        limit = max_timestep(scene.replace(integrator=method))
        if 0.0 < limit < math.inf:
            worst = max(spectral_radius(method, k, z, limit) for k, z in poses)
            assert worst <= 1 + 3e-7, method  # a motion that nothing holds has a double root at 1, found to the root of round-off


def test_drag_that_still_air_does_not_exert_steadies_no_scene():
    """Pressure of the air is bounded from above alone: a cloth at rest in still air feels none."""
    bare = presets.flag(3, 4, viscosity=0.0, drag=0.0)
    for scene in (bare, bare.adding(AirPressure())):
        assert max_timestep(scene.replace(integrator=ExplicitEuler())) == 0.0
    rk4 = [max_timestep(scene.replace(integrator=RK4())) for scene in (bare, bare.adding(AirPressure(max_speed=0.1)))]
    assert rk4[1] <= rk4[0]


@pytest.mark.parametrize("line", [(1.0, 2.0, 4.0), (1.0, 0.0, 4.0), (0.0, 1.0, 2.0), (1.0, -1.0, 1e-12), (1.0, -1.258, 8.0)])
@pytest.mark.parametrize("copies", [1, 4])
def test_edge_is_found_from_below_though_modes_coincide(line, copies):
    """Copies of a chain, each with the same modes; K and Z share them, so the edge is a root of one mode."""
    p, q, r = line
    chain = np.diag(np.full(30, 2.0)) - np.diag(np.ones(29), 1) - np.diag(np.ones(29), -1)
    k, z = np.kron(np.eye(copies), 500.0 * chain), np.kron(np.eye(copies), 0.02 * chain + 0.3 * np.eye(30))
    parts = scipy.sparse.csr_array(k), scipy.sparse.csr_array(z)
    modes = np.linalg.eigvalsh(chain)
    known = min(positive_root(p * 500.0 * mode, q * (0.02 * mode + 0.3), r) for mode in modes)
    pencil = Pencil(line, lambda _: parts)
    found, vector = pencil.edge(known * 1e-3)
    assert known * (1 - 2 * MARGIN) <= found <= known * (1 + 1e-12)
    assert pencil.is_definite(found)
    assert not pencil.is_definite(known * (1 + 1e-8))
    bound = positive_root(p * (vector @ k @ vector), q * (vector @ z @ vector), r * (vector @ vector))
    assert known * (1 - 1e-9) <= bound <= known * (1 + MARGIN)


@pytest.mark.parametrize("line", [(1.0, 2.0, 4.0), (1.0, -1.258, 8.0)])
def test_bisection_takes_over_where_no_step_is_proposed_well(line, monkeypatch):
    """Vectors that bound the edge badly cost time, but neither safety nor sharpness."""
    p, q, r = line
    random = np.random.default_rng(3)
    k, z = (m @ m.T for m in random.standard_normal((2, 40, 40)))
    monkeypatch.setattr(certificate, "_lanczos", lambda matrix, start, *_: start)
    found, _ = Pencil(line, lambda _: (scipy.sparse.csr_array(k), scipy.sparse.csr_array(z))).edge(1e-4)

    def top(h):
        return np.linalg.eigvalsh(p * h**2 * k + q * h * z)[-1]

    assert top(found) < r < top(found * (1 + 4 * MARGIN))


@pytest.mark.parametrize("large", [False, True])
def test_a_factor_solves_and_is_refused_to_an_indefinite_matrix(large, monkeypatch):
    monkeypatch.setattr(certificate, "_LARGE", 0.0 if large else math.inf)
    random = np.random.default_rng(5)
    band = scipy.sparse.diags_array([random.random(60), *random.standard_normal((3, 60))], offsets=[0, 1, 2, 5], shape=(60, 60))
    matrix = scipy.sparse.csr_array(band + band.T)
    least = np.linalg.eigvalsh(matrix.toarray())[0]
    for shift in (1e-6, 0.1, 3.0):
        definite = matrix + (shift - least) * scipy.sparse.eye_array(60)
        right = random.standard_normal(60)
        assert factor(definite)(right) == pytest.approx(np.linalg.solve(definite.toarray(), right), rel=1e-6)
        assert factor(matrix - (shift + least) * scipy.sparse.eye_array(60)) is None


def test_anchors_and_drag_add_to_the_diagonals_of_a_pose():
    """One free particle between two pinned ones, tied to a point: w^2 = (2 k + anchor) / m, rate = (2 z + drag) / m."""
    lattice = Lattice(1, 1, 3, 1.0, 0.25, pinned="ends", dimensions=1)
    two, one = np.ones(2), np.array([7.0, 3.0, 7.0])
    terms = Terms(np.array([0, 1]), np.array([1, 2]), 5.0 * two, 0.5 * two, 0.5 * two, one, 0.1 * one, 0.1 * one)
    matrices = Matrices(lattice, terms)
    assert matrices.of(terms.stiffness, terms.anchor).toarray() == pytest.approx(np.array([[(10.0 + 3.0) / 0.25]]))
    assert matrices.of(terms.viscosity, terms.drag).toarray() == pytest.approx(np.array([[(1.0 + 0.3) / 0.25]]))


@pytest.mark.parametrize("tears", [False, True])
def test_limits_of_large_lattices_are_proven_alike(tears, monkeypatch):
    scene = presets.flag(9, 12, viscosity=0.05)
    scene = scene.adding(Bending(4.0, 0.0), *([Tearing(0.5)] if tears else []))
    exact = {method: method.limit(SceneSpectrum(scene.lattice, scene.effects)) for method in METHODS}
    monkeypatch.setattr(certificate, "_LARGE", 0.0)
    for method, limit in exact.items():
        assert method.limit(SceneSpectrum(scene.lattice, scene.effects)) == pytest.approx(limit, rel=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_limits_lie_at_most_half_a_percent_below_the_sharp_ones(seed):
    """Lines without a gain against the dense top eigenvalue."""
    scene = random_scene(np.random.default_rng((78, seed)))
    bounds = SceneSpectrum(scene.lattice, scene.effects)
    k, z = bounds.stiffness.toarray(), bounds.damping.toarray()
    for p, q, r in ((1.0, 2.0, 4.0), (1.0, 4.0, 4.0), (1.0, 0.0, 4.0), (0.0, 1.0, 2.0)):
        h = bounds.largest_step(p, q, r)
        if h < math.inf:
            top = [np.linalg.eigvalsh(p * (f * h) ** 2 * k + q * f * h * z)[-1] for f in (1.0, 1.005)]
            assert top[0] <= r * (1 + 1e-12) < top[1]
