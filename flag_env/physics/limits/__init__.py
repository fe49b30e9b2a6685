"""The largest stable timestep of a scene, known before it runs, and what sets it."""

from flag_env.physics.limits.spectrum import SceneSpectrum
from flag_env.physics.limits.step_limit import AUTO, UNLIMITED, forget_limits, limited_by, max_timestep, scaled, timestep_of

__all__ = ["AUTO", "UNLIMITED", "SceneSpectrum", "forget_limits", "limited_by", "max_timestep", "scaled", "timestep_of"]
