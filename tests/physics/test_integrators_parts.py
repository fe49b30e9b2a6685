"""The parts of the integrators: the banded factor, and compiled methods beside their sources."""

import pickle

import numpy as np
import pytest

from flag_env.physics import presets
from flag_env.physics.compiling.decorators import jit
from flag_env.physics.integrators._linear_algebra import factorise, improve
from flag_env.physics.limits.spectrum import SceneSpectrum
from tests.physics.test_integrators_order import MAST, METHODS, beginning, smooth


@jit
def solved(factor, change, f, r, h):
    improve(factor, change, f, r, h)


@pytest.mark.parametrize(
    "scene", [presets.flag(5, 9), presets.two_layer_flag(3, 4), presets.rope(3), presets.flag(2, 2)], ids=str
)
def test_banded_factor_solves_the_system(scene):
    spectrum = SceneSpectrum(scene.lattice, scene.effects)
    p, q, h = 0.003, 2e-5, 0.7
    factor = factorise(spectrum, np.dtype(float), p, q)
    random = np.random.default_rng(0)
    change, f = random.standard_normal((2, scene.lattice.dimensions, scene.lattice.size))
    found = change.copy()
    solved(factor, found, f, np.zeros((3, scene.lattice.size)), h)
    root = np.sqrt(spectrum.masses)
    matrix = np.outer(root, root) * (np.eye(len(root)) + (p * spectrum.damping + q * spectrum.stiffness).toarray())
    free = spectrum.free
    expected = np.linalg.solve(matrix, (h * f - scene.lattice.masses * change)[:, free].T).T
    np.testing.assert_allclose((found - change)[:, free], expected, rtol=1e-11, atol=1e-13 * np.abs(expected).max())
    assert not (found - change)[:, scene.lattice.fixed].any()


def test_band_is_as_narrow_as_the_cloth():
    for rows, cols in ((6, 20), (20, 6)):
        scene = presets.flag(rows, cols)
        factor = factorise(SceneSpectrum(scene.lattice, scene.effects), np.dtype(float), 1.0, 1.0)
        assert factor.columns.shape[1] <= 24


def test_compiled_methods_compute_what_their_sources_say(run_python, tmp_path):
    x, v = beginning(smooth("isotropic"))
    with (tmp_path / "cases").open("wb") as file:
        pickle.dump(([smooth("isotropic", method, timestep=2e-3) for method in METHODS], x, v), file)
    script = f"""
import pickle, numpy as np, numba
from flag_env.physics import Simulator
scenes, x, v = pickle.load(open({str(tmp_path / "cases")!r}, "rb"))
ends = []
for scene in scenes:
    sim = Simulator(scene)
    sim.set_positions(x)
    sim.set_velocities(v)
    sim.set_mast({MAST.tolist()})
    sim.step(3)
    sim.step(1)
    ends.append((sim.positions, sim.velocities))
pickle.dump((numba.config.DISABLE_JIT, np.array(ends)), open({str(tmp_path)!r} + "/ends", "wb"))
"""
    ends = []
    for disable in ("1", "0"):
        run_python(script, NUMBA_DISABLE_JIT=disable)
        with (tmp_path / "ends").open("rb") as file:
            disabled, found = pickle.load(file)
        assert disabled == int(disable)
        ends.append(found)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-13)
