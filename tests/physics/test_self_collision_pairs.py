"""Self-collision finds the pairs that brute force finds, by cells and by blocks."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from flag_env.physics import Lattice, Simulator
from flag_env.physics.effects import SelfCollision
from flag_env.physics.effects.base import BindContext
from flag_env.physics.effects.contact import cells
from flag_env.physics.effects.contact.blocks import find_pairs_by_blocks
from tests.physics.test_self_collision_crossings import CLOTH, COLLIDING


def bound_to(effect, lattice, dtype="float64"):
    return effect.bind(BindContext(lattice, np.dtype(dtype), copies=1, timestep=1e-3, seed=0))


def listed_pairs(x, data):
    """Pairs that the cell lists find in x (particles, 3); None if they do not fit the list."""
    dtype = data.rest.dtype
    x = np.ascontiguousarray(x.T, dtype)
    effect_work = np.empty_like(x)
    where = data.start[0], data.place[0], data.order[0], data.column[0]
    finite = cells.sort_into_cells(*x, data.per_cell, *where, *effect_work, x.shape[1])
    one, two = data.pairs[0]
    count, searched = cells.find_pairs(*effect_work, data.per_cell, *where, data.code, data.free, data.reach, 0, one, two, finite)
    if searched < finite:
        return None
    pairs = np.sort(np.stack([one[:count], two[:count]], axis=1).astype(int), axis=1)
    assert len(np.unique(pairs, axis=0)) == count  # none twice
    return {tuple(pair) for pair in pairs}


def brute_pairs(x, lattice, reach):
    """The same from all pairs of x, in its own precision; neighbours are those within a cell's diagonal in one layer."""
    rest = lattice.rest_positions.reshape(-1, 3)
    i, j = np.triu_indices(len(x), 1)
    with np.errstate(invalid="ignore", over="ignore"):
        d = x[j] - x[i]
        near = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] + d[:, 2] * d[:, 2] < reach * reach
    linked = (rest[i, 1] == rest[j, 1]) & (pdist(rest) < 1.01 * np.hypot(*lattice.spacings[:2]))
    return set(zip(i[near & ~linked].tolist(), j[near & ~linked].tolist(), strict=True))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("spacing", [0.1, (0.04, 0.1), (0.1, 0.03, 0.2)])
@pytest.mark.parametrize("shape", [(1, 12, 16), (2, 5, 9), (1, 1, 40), (1, 2, 2), (3, 7, 1)])
def test_cells_find_the_pairs_that_brute_force_finds(shape, spacing, dtype):
    lattice = Lattice(*shape, spacing, pinned="none")
    data = bound_to(SelfCollision(), lattice, dtype)
    random = np.random.default_rng(0)
    seen = 0
    for spread in (0.02, 0.1, 0.3, 1.0):
        for shift in (0.0, -7.3, 1e3):
            x = (shift + spread * random.standard_normal((lattice.size, 3))).astype(dtype)
            x[: len(x) // 8] += np.array([1e9, -1e9, 1e5], dtype)  # far outside, most of them in one place
            x[len(x) // 2] = x[-1]  # coincident
            found, expected = listed_pairs(x, data), brute_pairs(x, lattice, data.reach)
            if found is None:
                assert len(expected) > data.pairs.shape[2] - lattice.size
                continue
            assert found == expected
            seen += len(found)
    assert seen > 0 or lattice.size == 4


def test_cells_find_neighbours_across_borders_and_leave_out_what_is_not_finite():
    lattice = Lattice(1, 8, 8, 0.1, pinned="none")
    data = bound_to(SelfCollision(), lattice)
    grid = np.stack(np.meshgrid(*[np.arange(-2, 2) * float(1 / data.per_cell)] * 3), axis=-1).reshape(-1, 3)
    for scale in (1.0, 0.999, np.nextafter(0.999, 0), 0.7, 0.5):
        assert listed_pairs(scale * grid, data) == brute_pairs(scale * grid, lattice, data.reach)
    grid[[3, 20, 41]] = [[np.nan, 0, 0], [0, np.inf, 0], [-np.inf, np.nan, 1e308]]
    grid[[5, 6]] = [[1e300, -1e300, 1e300], [1e300, -1e300, 1e300]]
    assert listed_pairs(0.5 * grid, data) == brute_pairs(0.5 * grid, lattice, data.reach)


def crumpled(lattice, seed, size):
    """A smooth random pose in which far parts meet; `size` is about its extent in rest extents."""
    random = np.random.default_rng(seed)
    x = lattice.rest_positions.copy()
    phase = x[..., [0]] * random.uniform(3, 9) + x[..., [2]] * random.uniform(3, 9) + random.uniform(0, 6, 3)
    return (size * x + 0.05 * np.cos(phase) + 0.004 * random.standard_normal(x.shape)).reshape(-1, 3)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("spacing", [0.05, (0.02, 0.05), (0.06, 0.02, 0.1)])
@pytest.mark.parametrize("shape", [(1, 12, 16), (2, 7, 9), (3, 4, 4), (1, 5, 2), (1, 9, 31)])
def test_blocks_find_the_pairs_that_brute_force_finds(shape, spacing, dtype):
    lattice = Lattice(*shape, spacing, pinned="none")
    data = bound_to(SelfCollision(), lattice, dtype)
    suited = 0
    for seed in range(8):
        for size in (1.0, 0.6, 0.2):
            x = crumpled(lattice, seed, size).astype(dtype)
            pairs = np.zeros_like(data.pairs[0])
            where = data.start[0], data.place[0], data.order[0], data.column[0]
            rows = np.ascontiguousarray(x.T)
            count = find_pairs_by_blocks(rows, data.blocks, data.code, data.free, data.reach, *where, pairs, np.empty_like(rows))
            if count < 0:
                continue
            suited += 1
            found = np.sort(pairs[:, :count].T.astype(int), axis=1)
            assert len(np.unique(found, axis=0)) == count
            assert {tuple(pair) for pair in found} == brute_pairs(x, lattice, data.reach)
    assert suited > 6 or lattice.size < 50


def test_torn_and_stretched_cloth_is_searched_too():
    """Where blocks do not suit, a run finds what brute force finds."""
    sim = Simulator(COLLIDING.replace(perturbation=0.0))
    x = CLOTH.lattice.rest_positions.copy()
    x[:, 6:, :, 0] += 3.0  # torn in two, one half
    x[:, 9:, :] += (-0.1, 0.05, -0.3)  # and folded
    sim.set_positions(x)
    sim.step()
    data = sim.run.effects[-1]
    found = {tuple(sorted(pair)) for pair in data.pairs[0, :, : data.listed_pairs[0]].T.astype(int).tolist()}
    assert found == brute_pairs(data.listed[0].T, CLOTH.lattice, data.reach)
    assert found
