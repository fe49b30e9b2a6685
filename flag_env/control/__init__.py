"""From an action to what the physics sees: one control a file."""

from flag_env.control.base import CONTROL_STEP, Control
from flag_env.control.both import BothControl
from flag_env.control.mast import MastControl, MastYawControl, mast_pose
from flag_env.control.wind import WindControl, wind_of
from flag_env.control.wind_frequency import WindFrequencyControl

CONTROLS: dict[str, type[Control]] = {
    "wind": WindControl,
    "mast": MastControl,
    "both": BothControl,
    "wind+frequency": WindFrequencyControl,
    "mast+yaw": MastYawControl,
}
"""What the environments' `control` argument stands for."""

__all__ = [
    "CONTROLS", "CONTROL_STEP", "BothControl", "Control", "MastControl", "MastYawControl", "WindControl", "WindFrequencyControl",
    "mast_pose", "wind_of",
]  # fmt: skip
