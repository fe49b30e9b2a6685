"""The scenes and methods that the accuracy study measures."""

from __future__ import annotations

import math

from flag_env.control import WindControl, wind_of
from flag_env.envs.config import DEFAULT_SCENE, WIND
from flag_env.physics import Lattice, Scene, max_timestep
from flag_env.physics.effects import Bending, CosineWind, CrossLayer, Gravity, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Implicit, Integrator, Leapfrog, Strang
from flag_env.tasks import LEVELS

METHODS: dict[str, Integrator] = {
    "explicit Euler": ExplicitEuler(),
    "leapfrog (report)": Leapfrog(),
    "leapfrog (half kick)": Leapfrog("half_kick"),
    "LFAB": LFAB(),
    "Strang": Strang(),
    "RK4": RK4(),
    "implicit": Implicit(),
}

ENVIRONMENT = "Flag-v0"
"""The scene for which the accuracy presets are chosen."""

_MEAN_MASS = 4e-3 * 0.55
"""Of the particles of one layer [kg]: the winds are given as accelerations of it."""


def scenes() -> dict[str, Scene]:
    """The environments' flag, and three of 1.5 m x 0.9 m, 16 x 10 particles, whose mass alone tapers: a light edge sets the step.

    Flag-v0: the default scene of the environments in the hardest steady wind of an episode; calm: a flag swings in a slow breeze;
    gusty: gusts of four times its weight throw it about, and errors grow; two-layer: struts and cube diagonals hold two layers
    apart in the same gusts.
    """
    return {
        ENVIRONMENT: _episode(),
        "calm": _flag(1, (0.0, 1.0, 0.0), (0.0, 3.0, 0.0), (2.0, 0.5, 0.0)),
        "gusty": _flag(1, (10.0, 40.0, 10.0), (5.0, 7.0, 3.0), (10.0, 5.0, 0.0)),
        "two-layer": _flag(2, (10.0, 40.0, 10.0), (5.0, 7.0, 3.0), (10.0, 5.0, 0.0)),
    }


def _episode() -> Scene:
    """The environments' flag under full action, with the largest hidden wind, from rest; in float64, as the other scenes."""
    mean, amplitude = (wind_of(DEFAULT_SCENE, part).tolist() for part in (WIND + LEVELS["breeze"].hidden_wind, WindControl.gain))
    wind = CosineWind(tuple(amplitude), tuple(WindControl.frequency.tolist()), tuple(mean))
    return DEFAULT_SCENE.adding(wind).replace(dtype="float64")


def _flag(layers: int, amplitude: tuple[float, ...], frequency: tuple[float, ...], mean: tuple[float, ...]) -> Scene:
    """Dampers of 1e-4 s times the stiffness, all isotropic; `amplitude` and `mean` of the wind [m/s^2]."""
    cross = Shear if layers == 1 else CrossLayer
    force = _MEAN_MASS / layers
    wind = CosineWind(tuple(force * a for a in amplitude), frequency, tuple(force * m for m in mean))
    return Scene(
        Lattice(layers, 10, 16, 0.1, 4e-3 / layers, 0.1),
        (Gravity(), Structural(2000.0, 0.2), cross(1000.0, 0.1), Bending(100.0, 0.01), wind),
        LFAB(),
    )


def stepped(scene: Scene, share: float, unit: float) -> Scene:
    """The scene with `share` of its step limit, reduced so that `unit` seconds hold a whole number of steps.

    A method without a limit takes shares of 16 undamped explicit limits.
    """
    limit = max_timestep(scene)
    if not math.isfinite(limit):
        limit = 16 * max_timestep(scene.replace(integrator=Strang()))
    return scene.replace(timestep=unit / math.ceil(unit / (share * limit)))
