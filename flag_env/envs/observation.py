"""What stands where in a flat observation: one layout for the kernel that writes it, the views, the baselines and the pages."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flag_env.control import Control
from flag_env.physics import Scene

OBSERVED = (3, 5)
"""Rows and columns of the observed nodes."""

MARKERS = ((0.0, 1.0), (1.0, 1.0), (5 / 9, 8 / 15))
"""Where the markers of the view "sensors" are: shares of the way up and along."""

LOOKAHEAD = (1, 3, 6, 12)
"""Steps by which the view "wave" sees the target in advance."""

PARTS = {
    "nodes": ("positions", "velocities", "targets", "differences", "actuators", "time_left"),
    "mast": ("positions", "velocities", "targets", "differences", "actuators", "mast_target", "mast_error", "time_left"),
    "sensors": ("positions", "targets", "differences", "actuators", "time_left"),
    "wave": ("positions", "velocities", "ahead", "actuators", "time_left"),
}
"""What each view shows."""

BOUND = 100.0
"""Largest magnitude of an entry; what is larger is clipped."""


@dataclass(frozen=True)
class ObservationLayout:
    """Slices of a flat observation.

    Attributes
    ----------
    positions, velocities, targets
        Of the nodes, x, y, z of each, row by row from below [m], [m/s], [m].
    differences
        Target minus position, in the control's `error_scale` flag diagonals.
    ahead
        Target in 1, 3, 6 and 12 steps minus position, in 0.1 flag diagonals.
    actuators
        The control's state.
    mast_target, mast_error
        Where the target's mast is, and how far from the flag's, in shares of the mast's range.
    time_left
        Share of the episode that is left.
    """

    positions: slice
    velocities: slice
    targets: slice
    differences: slice
    ahead: slice
    actuators: slice
    mast_target: slice
    mast_error: slice
    time_left: slice

    @classmethod
    def of(cls, nodes: int, control: type[Control], view: str = "nodes") -> ObservationLayout:
        """The layout of a view of so many nodes under this control; parts that it does not show are empty."""
        at, mast = 3 * nodes, control.mast_pose or slice(0, 0)
        lengths = [at, at, at, at, len(LOOKAHEAD) * at, control.state_size, *[mast.stop - mast.start] * 2, 1]
        shown = [n * (part.name in PARTS[view]) for n, part in zip(lengths, fields(cls), strict=True)]
        return cls(*(slice(start, end) for start, end in pairwise(np.cumsum([0, *shown]).tolist())))

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(self.time_left.stop)

    @property
    def starts(self) -> NDArray[np.int64]:
        """First entry of each part, for the kernel; -1 for one that is not shown."""
        parts = [getattr(self, part.name) for part in fields(self)]
        return np.array([part.start if part.stop > part.start else -1 for part in parts])


def observed_nodes(scene: Scene, view: str = "nodes") -> NDArray[np.int64]:
    """Flat numbers of the observed particles: evenly spread over layer 0, the mast's column left out, or its markers."""
    _, rows, cols = scene.lattice.shape
    if view == "sensors":
        return np.array([round(up * (rows - 1)) * cols + round(along * (cols - 1)) for up, along in MARKERS])
    row = np.rint(np.linspace(0, rows - 1, OBSERVED[0])).astype(np.int64)
    col = np.rint(np.linspace(min(1, cols - 1), cols - 1, OBSERVED[1])).astype(np.int64)
    return (row[:, None] * cols + col).ravel()
