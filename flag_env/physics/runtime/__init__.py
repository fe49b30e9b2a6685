"""The arrays of a scene in motion: effects bound to them, their state, frames read from them, the mast, threads."""

from flag_env.physics.runtime.aligned import padded_row, zeros
from flag_env.physics.runtime.binding import state_of, winds
from flag_env.physics.runtime.frame import Frame
from flag_env.physics.runtime.mast import mast_points, mast_poses
from flag_env.physics.runtime.run import Run
from flag_env.physics.runtime.state import Diverged, State
from flag_env.physics.runtime.threads import Threads, processors

__all__ = [
    "Diverged", "Frame", "Run", "State", "Threads", "mast_points", "mast_poses", "padded_row", "processors", "state_of", "winds",
    "zeros",
]  # fmt: skip
