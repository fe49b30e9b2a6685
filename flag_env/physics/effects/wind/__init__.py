"""What winds share: a mean that swings, turbulence in time, and the forces on a cloth's triangles."""

from flag_env.physics.effects.wind.base import Oscillation, Wind, advance_phase, oscillation_value
from flag_env.physics.effects.wind.pressure import TINY, Cloth, TearingCloth, press
from flag_env.physics.effects.wind.turbulence import Turbulence, advance_turbulence, filter_coefficients, stationary_past

__all__ = [
    "TINY",
    "Cloth",
    "Oscillation",
    "TearingCloth",
    "Turbulence",
    "Wind",
    "advance_phase",
    "advance_turbulence",
    "filter_coefficients",
    "oscillation_value",
    "press",
    "stationary_past",
]
