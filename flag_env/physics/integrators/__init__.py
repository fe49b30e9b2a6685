"""The catalogue of integrators: one file each."""

from flag_env.physics.integrators._linear_algebra import bandwidth
from flag_env.physics.integrators.base import DAMPED, Integrator, Spectrum, positive_root
from flag_env.physics.integrators.explicit_euler import ExplicitEuler
from flag_env.physics.integrators.implicit import Implicit
from flag_env.physics.integrators.leapfrog import Leapfrog
from flag_env.physics.integrators.lfab import LFAB
from flag_env.physics.integrators.rk4 import RK4
from flag_env.physics.integrators.strang import Strang

CATALOGUE: tuple[Integrator, ...] = (LFAB(), Leapfrog(), RK4(), Strang(), Implicit(), ExplicitEuler())
"""One of each."""

__all__ = [
    "CATALOGUE", "DAMPED", "LFAB", "RK4", "ExplicitEuler", "Implicit", "Integrator", "Leapfrog", "Spectrum", "Strang",
    "bandwidth", "positive_root",
]  # fmt: skip
