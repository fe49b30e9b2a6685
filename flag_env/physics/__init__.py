"""Mass-spring cloth in NumPy, Numba and SciPy; usable with no reinforcement-learning library installed."""

from flag_env.physics import effects, integrators, presets
from flag_env.physics.lattice import Lattice
from flag_env.physics.limits import max_timestep
from flag_env.physics.runtime import Diverged, Frame, State
from flag_env.physics.scene import Scene
from flag_env.physics.simulator import Simulator

from flag_env.physics.gradients import Gradient, Rollout  # isort: skip
from flag_env.physics.accuracy import Description, describe, tune  # isort: skip

__all__ = [
    "Description", "Diverged", "Frame", "Gradient", "Lattice", "Rollout", "Scene", "Simulator", "State", "describe", "effects",
    "integrators", "max_timestep", "presets", "tune",
]  # fmt: skip
