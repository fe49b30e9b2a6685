"""Checks the compiled flag against the student report's model, written a second time from its text with lists of links."""

from itertools import product

import numpy as np
import pytest
import scipy.sparse

from flag_env.physics import Simulator, presets

RATE = 1000.0
AMPLITUDE = np.array([4800.0, 5700.0, 1150.0])  # the report's axes: along, vertical, normal
FREQUENCY = np.array([0.04, 0.35, 0.05])
STEPS, EVERY = 4000, 500


def report_links(layers, rows, cols):
    """Every link as a pair of (layer, row, col), from the report's description."""

    def near(particle, *step):
        other = tuple(a + b for a, b in zip(particle, step, strict=True))
        return other if all(0 <= a < n for a, n in zip(other, (layers, rows, cols), strict=True)) else None

    directions = [(0, 0, 1), (0, 1, 0)]  # structural
    directions += [(0, 0, 2), (0, 2, 0)]  # bending
    if layers == 1:
        directions += [(0, 1, 1), (0, 1, -1)]  # the two diagonals of a face
    else:
        directions += [(1, 0, 0)]  # struts
        directions += [(1, a, b) for a in (-1, 1) for b in (-1, 1)]  # the four diagonals of a cube
    particles = product(range(layers), range(rows), range(cols))
    return [(p, near(p, *d)) for p in particles for d in directions if near(p, *d)]


def report_run(layers, rows=10, cols=15):
    """Positions (layers, rows, cols, 3) in the report's axes, every 500 steps."""
    number = {p: i for i, p in enumerate(product(range(layers), range(rows), range(cols)))}
    x = np.array([(col, row, layer) for layer, row, col in number], float)
    share = np.array([1.0 - 0.9 * col / (cols - 1) for _, _, col in number])
    links = report_links(layers, rows, cols)
    first = np.array([number[p] for p, _ in links])
    second = np.array([number[q] for _, q in links])
    rest = np.linalg.norm(x[second] - x[first], axis=1)
    mean_share = (share[first] + share[second]) / 2
    k, z = 0.1 * RATE**2 * mean_share, 0.01 * RATE * mean_share
    free = np.array([col > 0 for _, _, col in number])
    incidence = np.zeros((len(number), len(links)))
    incidence[first, np.arange(len(links))] = 1.0
    incidence[second, np.arange(len(links))] = -1.0
    incidence = scipy.sparse.csr_array(incidence)
    w = np.zeros_like(x)
    h = 1.0 / RATE
    frames = []
    for step in range(STEPS):
        if step % EVERY == 0:
            frames.append(x.copy())
        apart = x[second] - x[first]
        length = np.sqrt((apart**2).sum(axis=1))
        pull = (k * (1.0 - rest / length))[:, None] * apart + z[:, None] * (w[second] - w[first])
        force = incidence @ pull
        force[:, 1] -= 5.0 * RATE
        force += AMPLITUDE * np.cos(FREQUENCY * step * h)
        w[free] += h * force[free] / share[free, None]
        x[free] += h * w[free]
    return np.array([*frames, x]).reshape(-1, layers, rows, cols, 3)


@pytest.mark.parametrize(("layers", "links"), [(1, 777), (2, 1704)])
def test_positions_equal_those_of_the_report(layers, links):
    expected = report_run(layers)
    assert len(report_links(layers, 10, 15)) == links
    sim = Simulator(presets.report_flag(layers=layers))
    assert sim.timestep == 1 / RATE
    frames = [sim.positions[0]]
    for _ in range(STEPS // EVERY):
        sim.step(EVERY)
        frames.append(sim.positions[0])
    vertical_last = expected[..., [0, 2, 1]]
    span = np.ptp(expected[-1].reshape(-1, 3), axis=0).max()
    assert np.abs(expected[-1] - expected[0]).max() > 1.0  # it did move
    np.testing.assert_allclose(np.array(frames), vertical_last, rtol=0, atol=1e-10 * span)
