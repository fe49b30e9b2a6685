"""From an action to what the physics sees: one control a file."""

from flag_env.control.base import CONTROL_STEP, Control
from flag_env.control.mast import MastControl
from flag_env.control.wind import WindControl, wind_of

CONTROLS: dict[str, type[Control]] = {"wind": WindControl, "mast": MastControl}
"""What the environments' `control` argument stands for."""

__all__ = ["CONTROLS", "CONTROL_STEP", "Control", "MastControl", "WindControl", "wind_of"]
