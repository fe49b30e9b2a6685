"""From an action to what the physics sees: one control a file."""

from flag_env.control.base import Control
from flag_env.control.mast import MastControl
from flag_env.control.wind import WindControl

CONTROLS: dict[str, type[Control]] = {"wind": WindControl, "mast": MastControl}
"""What the environments' `control` argument stands for."""

__all__ = ["CONTROLS", "Control", "MastControl", "WindControl"]
