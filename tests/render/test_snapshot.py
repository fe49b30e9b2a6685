"""What a snapshot accepts, copies and freezes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from render_flags import BOUNDS, MAST, lattice

from flag_env.render import Snapshot


def test_arrays_are_copied_and_read_only(make):
    positions = lattice()
    snapshot = make(positions=positions, target=positions, wind=[1, 2, 3])
    before = snapshot.positions.copy()
    positions += 1.0
    np.testing.assert_array_equal(snapshot.positions, before)
    np.testing.assert_array_equal(snapshot.target, before)
    for name in ("positions", "target", "mast", "wind", "bounds"):
        array = getattr(snapshot, name)
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    intact = np.ones((1, 9, 15), bool)
    snapshot = make(intact=intact)
    intact[:] = False
    assert snapshot.intact.all()
    assert not snapshot.intact.flags.writeable
    with pytest.raises(dataclasses.FrozenInstanceError):
        snapshot.success = True


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"positions": np.zeros((10, 16, 3))}, r"positions.*\(10, 16, 3\).*\(layers, rows, cols, 3\)"),
        ({"positions": np.zeros((1, 10, 16, 2))}, "positions.*2"),
        ({"positions": np.zeros((1, 0, 16, 3))}, "positions.*0"),
        ({"positions": np.full((1, 2, 2, 3), np.nan)}, "positions.*nan.*finite"),
        ({"positions": np.full((1, 2, 2, 3), np.inf)}, "positions.*inf.*finite"),
        ({"positions": "flag"}, "positions.*'flag'"),
        ({"target": np.zeros((1, 4, 4, 3))}, r"target.*\(1, 4, 4, 3\).*\(1, 10, 16, 3\)"),
        ({"mast": np.zeros(3)}, r"mast.*\(3,\).*\(2, 3\)"),
        ({"wind": np.zeros(2)}, r"wind.*\(2,\).*\(3,\)"),
        ({"bounds": BOUNDS[::-1]}, "bounds.*lowest < highest"),
        ({"wind_scale": 0.0}, "wind_scale.*0.0.*> 0"),
        ({"distance": -1.0}, "distance.*-1.0.*>= 0"),
        ({"distance": np.nan}, "distance.*nan"),
        ({"tolerance": 0.0}, "tolerance.*0.0.*> 0"),
        ({"intact": np.ones((1, 10, 16), bool)}, r"intact.*\(1, 10, 16\).*\(1, 9, 15\)"),
        ({"intact": np.ones((1, 9, 15))}, "intact.*float64.*bool"),
    ],
)
def test_refuses_with_the_name_the_value_and_what_is_allowed(make, changes, words):
    with pytest.raises(ValueError, match=words):
        make(**changes)


def test_positional_order():
    snapshot = Snapshot(lattice(), MAST, BOUNDS)
    assert snapshot.target is None
    assert snapshot.wind is None
    assert snapshot.distance is None
    assert not snapshot.success
