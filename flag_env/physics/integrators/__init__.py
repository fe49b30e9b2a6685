"""The catalogue of integrators: one file each."""

from flag_env.physics.integrators.base import Integrator
from flag_env.physics.integrators.leapfrog import Leapfrog

__all__ = ["Integrator", "Leapfrog"]
