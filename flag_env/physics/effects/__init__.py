"""The catalogue of effects: one file each."""

from flag_env.physics.effects.air_drag import AirDrag
from flag_env.physics.effects.air_pressure import AirPressure
from flag_env.physics.effects.attachment import Attachment
from flag_env.physics.effects.base import BindContext, Effect, Key, LinearBound, LinkGroup, LinkTerm
from flag_env.physics.effects.bending import Bending
from flag_env.physics.effects.contract import check_contract
from flag_env.physics.effects.cosine_wind import CosineWind
from flag_env.physics.effects.cross_layer import CrossLayer
from flag_env.physics.effects.gravity import Gravity
from flag_env.physics.effects.gusts import Gusts
from flag_env.physics.effects.links import LinkEffect
from flag_env.physics.effects.mast_collision import MastCollision
from flag_env.physics.effects.self_collision import SelfCollision
from flag_env.physics.effects.shear import Shear
from flag_env.physics.effects.strain_limit import StrainLimit
from flag_env.physics.effects.structural import Structural
from flag_env.physics.effects.tearing import Tearing
from flag_env.physics.effects.wind import Wind

__all__ = [
    "AirDrag",
    "AirPressure",
    "Attachment",
    "Bending",
    "BindContext",
    "CosineWind",
    "CrossLayer",
    "Effect",
    "Gravity",
    "Gusts",
    "Key",
    "LinearBound",
    "LinkEffect",
    "LinkGroup",
    "LinkTerm",
    "MastCollision",
    "SelfCollision",
    "Shear",
    "StrainLimit",
    "Structural",
    "Tearing",
    "Wind",
    "check_contract",
]
