"""The film shows four episodes."""

import numpy as np
import pytest

from training.baselines import Zero
from training.environments import Task
from training.record import PAUSE, frames, record


def test_frames_are_four_pictures_of_one_moment():
    pictures = list(frames(Zero(Task(), "test"), Task(), "test", (0, 1, 2, 3), size=64, every=50))
    assert len(pictures) == 3 + PAUSE  # start, step 50, the end
    assert {picture.shape for picture in pictures} == {(130, 130, 3)}
    quarters = [pictures[2][top : top + 64, left : left + 64] for top in (0, 66) for left in (0, 66)]
    assert all(not np.array_equal(quarters[0], other) for other in quarters[1:])


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_a_film_is_written(tmp_path, suffix):
    path = record(tmp_path / f"agent.{suffix}", Zero(Task(), "test"), Task(), every=75, size=64)
    assert path.stat().st_size > 0
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("split", "targets", "named"),
    [
        ("test", (0, 1, 2, 128), "targets must be at most 127"),
        ("test", (0, 1, 2), "targets must be four numbers, got 3"),
        ("exam", (0, 1, 2, 3), "split must be one of"),
    ],
)
def test_what_is_no_target_of_the_task_is_refused_before_a_film_is_begun(tmp_path, split, targets, named):
    with pytest.raises(ValueError, match=named):
        record(tmp_path / "x.gif", Zero(Task(), "test"), Task(), split, targets)
    assert not any(tmp_path.iterdir())
