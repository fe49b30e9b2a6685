"""The catalogue of integrators: one file each."""

from flag_env.physics.integrators.base import Integrator
from flag_env.physics.integrators.explicit_euler import ExplicitEuler
from flag_env.physics.integrators.implicit import Implicit
from flag_env.physics.integrators.leapfrog import Leapfrog
from flag_env.physics.integrators.lfab import LFAB
from flag_env.physics.integrators.rk4 import RK4
from flag_env.physics.integrators.strang import Strang

__all__ = ["LFAB", "RK4", "ExplicitEuler", "Implicit", "Integrator", "Leapfrog", "Strang"]
