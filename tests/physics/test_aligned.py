"""Where arrays begin in the cache."""

import pytest

from flag_env.physics import Simulator, integrators, presets
from flag_env.physics.runtime import aligned


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("length", [1, 320, 1000, 1024, 4096, 20480, 81920, 81921])
def test_rows_begin_at_places_of_their_own(length, dtype):
    padded = aligned.padded_row(length, dtype)
    rows = aligned.zeros(5, (6, padded), dtype)
    assert padded >= length
    assert rows.flags.c_contiguous
    assert not rows.any()
    begin = [(row.ctypes.data // 64) % 64 for row in rows]  # lines of a page
    assert begin[0] == 5 * 512 // 64
    if length * rows.itemsize >= 4096:
        assert len(set(begin)) == 6
        assert padded * rows.itemsize <= length * rows.itemsize + 4096


def test_a_run_begins_its_arrays_at_places_of_their_own():
    run = Simulator(presets.flag(rows=32, cols=32, integrator=integrators.RK4()), copies=2).run
    arrays = [array for array in (run.x, run.v, run.history, *run._work[0]) if array.size]
    assert len(arrays) == 5
    assert len({array.ctypes.data % 4096 // 512 for array in arrays}) == 5
