"""Whatever an agent does, the flag stays in the picture, and off its signs."""

import itertools

import numpy as np
import pytest

from flag_env.envs.batch import FlagBatch
from flag_env.envs.config import FlagConfig
from flag_env.envs.picture import snapshot
from flag_env.render.camera import Camera
from flag_env.tasks import rungs

SIZES = ((480, 480), (640, 360), (300, 500))


SAME = {"sensors", "snap", "swing"}
"""Levels that move as others do."""


@pytest.mark.parametrize(("control", "level"), [rung for rung in rungs() if rung[1] not in SAME])
def test_no_legal_action_takes_a_particle_out_of_the_picture_or_onto_a_sign(control, level):
    """Actions at the corners of their box, held, and changed at random."""
    copies = 48
    batch = FlagBatch(FlagConfig(control=control, level=level), copies)
    rng = np.random.default_rng(0)
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=batch.control.size)))
    actions = corners[np.arange(copies) % len(corners)]
    batch.reset(range(copies), rng.integers(len(batch.library), size=copies))
    bounds = snapshot(batch).bounds
    for step in range(75):
        if step in (25, 50):
            actions = np.where(rng.random((copies, 1)) < 0.5, np.sign(rng.normal(size=actions.shape)), actions)
        batch.step(actions, actions.shape)
        for size in SIZES:
            pixels = Camera.framing(bounds, *size).project(batch.now.positions)[0]
            unit = min(size) / 480.0
            outside = (pixels < 0) | (pixels > size)
            on_gauge = pixels[..., 1] < 32.0 * unit
            on_sign = (pixels[..., 0] < 104.0 * unit) & (pixels[..., 1] > size[1] - 112.0 * unit)
            assert not outside.any(), (size, step)
            assert not (on_gauge | on_sign).any(), (size, step)
