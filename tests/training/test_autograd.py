"""The rollout in torch: the same derivatives, checked by torch itself."""

import numpy as np
import pytest
import torch

from flag_env.autograd import simulate
from flag_env.physics import Rollout, integrators, presets


def rollout():
    scene = presets.flag(rows=4, cols=5, stiffness=60.0, integrator=integrators.LFAB(), timestep=4e-3)
    return Rollout(scene, copies=2, parameters=())


def test_torch_finds_the_gradients_right():
    rng, run = np.random.default_rng(0), rollout()
    wind = torch.tensor(0.02 * rng.standard_normal((2, 2, 3)), requires_grad=True)
    mast = torch.tensor(0.05 * rng.standard_normal((2, 2, 5)), requires_grad=True)
    start = torch.tensor(run.scene.lattice.rest_positions + 0.01 * rng.standard_normal((2, 1, 4, 5, 3)), requires_grad=True)
    speed = torch.tensor(0.1 * rng.standard_normal((2, 1, 4, 5, 3)), requires_grad=True)
    arguments = (wind, mast, start, speed)
    assert torch.autograd.gradcheck(lambda *a: simulate(rollout(), 0.04, *a), arguments, eps=1e-5, atol=1e-6, fast_mode=True)


def test_what_asks_for_nothing_gets_nothing():
    run = rollout()
    wind = torch.zeros((1, 2, 3), dtype=torch.float32, requires_grad=True)
    path, _ = simulate(run, 0.1, wind)
    assert path.dtype == torch.float32
    path.square().sum().backward()
    direct = run.pull_back(2 * path.detach().numpy())
    np.testing.assert_allclose(wind.grad.numpy(), direct.wind, rtol=1e-5)


def test_a_later_run_is_noticed():
    run = rollout()
    wind = torch.zeros((1, 2, 3), requires_grad=True)
    path, _ = simulate(run, 0.1, wind)
    simulate(run, 0.1, wind)
    with pytest.raises(RuntimeError, match="keeps one run at a time"):
        path.sum().backward()
