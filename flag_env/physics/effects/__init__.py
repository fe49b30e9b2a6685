"""The catalogue of effects: one file each."""

from flag_env.physics.effects.air_drag import AirDrag
from flag_env.physics.effects.base import Effect, Wind
from flag_env.physics.effects.bending import Bending
from flag_env.physics.effects.cosine_wind import CosineWind
from flag_env.physics.effects.cross_layer import CrossLayer
from flag_env.physics.effects.gravity import Gravity
from flag_env.physics.effects.shear import Shear
from flag_env.physics.effects.springs import LinkEffect
from flag_env.physics.effects.structural import Structural

__all__ = [
    "AirDrag",
    "Bending",
    "CosineWind",
    "CrossLayer",
    "Effect",
    "Gravity",
    "LinkEffect",
    "Shear",
    "Structural",
    "Wind",
]
