"""The film shows four episodes."""

import numpy as np
import pytest

from training.baselines import Zero
from training.environments import Task
from training.record import PAUSE, frames, record


def test_frames_are_four_pictures_of_one_moment():
    pictures = list(frames(Zero(Task(), "test"), Task(), "test", (0, 1, 2, 3), size=32, every=50))
    assert len(pictures) == 3 + PAUSE  # start, step 50, the end
    assert {picture.shape for picture in pictures} == {(66, 66, 3)}
    quarters = [pictures[2][top : top + 32, left : left + 32] for top in (0, 34) for left in (0, 34)]
    assert all(not np.array_equal(quarters[0], other) for other in quarters[1:])


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_a_film_is_written(tmp_path, suffix):
    path = record(tmp_path / f"agent.{suffix}", Zero(Task(), "test"), Task(), every=75, size=32)
    assert path.stat().st_size > 0
    assert list(tmp_path.iterdir()) == [path]
