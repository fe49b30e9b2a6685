"""Mass-spring cloth in NumPy, Numba and SciPy; usable with no reinforcement-learning library installed."""

from flag_env.physics import effects, integrators, presets
from flag_env.physics.lattice import Lattice
from flag_env.physics.reading import Reading
from flag_env.physics.scene import Scene
from flag_env.physics.simulator import Simulator
from flag_env.physics.stability import max_timestep
from flag_env.physics.state import Diverged, State

__all__ = ["Diverged", "Lattice", "Reading", "Scene", "Simulator", "State", "effects", "integrators", "max_timestep", "presets"]
