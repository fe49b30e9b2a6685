"""What a motion tells of hidden scenes: intervals that hold the truth, derivatives that are right."""

import numpy as np
import pytest

from training.identification import NAMES, Identification
from training.identify import INTERVAL, hide, known_scene


@pytest.fixture(scope="module")
def scene():
    return known_scene(6, 8)


def test_hidden_values_lie_in_their_intervals(scene):
    """Of 4 x 5 intervals of 99.9 %, none misses; they are narrow, and the noise is found too."""
    for seed in range(4):
        truth, gusts, record = hide(scene, 25, 1e-3, seed)
        fit = Identification(scene, record, INTERVAL, gusts).fit(confidence=0.999)
        assert (fit.low <= truth).all(), (seed, fit, truth)
        assert (truth <= fit.high).all(), (seed, fit, truth)
        assert (fit.high - fit.low < 0.2 * np.abs(fit.values)).sum() >= 4
        free = (~scene.lattice.fixed).mean()
        assert fit.noise == pytest.approx(1e-3 * np.sqrt(free), rel=0.05)


def test_without_noise_the_truth_is_found(scene):
    truth, gusts, record = hide(scene, 20, 0.0, 7)
    fit = Identification(scene, record, INTERVAL, gusts).fit()
    np.testing.assert_allclose(fit.values, truth, rtol=1e-5, atol=1e-7)
    assert len(NAMES) == len(truth) == 5


def test_the_loss_has_its_derivatives(scene):
    _, gusts, record = hide(scene, 10, 1e-3, 1)
    fitted = Identification(scene, record, INTERVAL, gusts)
    at, rng = np.array([0.1, -0.2, 5.0, 1.0, 0.5]), np.random.default_rng(0)
    u = 1e-3 * rng.standard_normal(5)
    along = sum(c * (fitted._loss(at + k * u)[0] - fitted._loss(at - k * u)[0]) for k, c in ((1, 2 / 3), (2, -1 / 12)))
    assert fitted._loss(at)[1] @ u == pytest.approx(along, rel=1e-6)


def test_a_timestep_too_long_for_stiffer_cloth_is_told(scene):
    _, gusts, record = hide(scene, 4, 0.0, 1)
    with pytest.raises(ValueError, match="step limit above the timestep"):
        Identification(scene.replace(timestep="auto"), record, INTERVAL, gusts)
