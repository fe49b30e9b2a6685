"""What counts as success: a pose that is held, one that is met in time, or a motion that is followed."""

from __future__ import annotations

from dataclasses import dataclass

from flag_env import _validate


@dataclass(frozen=True)
class Goal:
    """When an episode is a success.

    Attributes
    ----------
    steps
        Number of steps in a row, up to now, on which the distance must be below the tolerance.
    earliest
        Steps of the episode before which there is no success.
    moving
        Whether the target moves along the witness, a pose a step, or stays where the witness ends.
    """

    steps: int
    earliest: int = 0
    moving: bool = False

    def __post_init__(self) -> None:
        _validate.count("steps", self.steps)
        _validate.count("earliest", self.earliest, minimum=0)
        _validate.boolean("moving", self.moving)


HOLD = Goal(steps=10)
"""The pose is held for ten steps."""

SNAP = Goal(steps=1, earliest=75)
"""The pose is met at the last step."""

WAVE = Goal(steps=65, earliest=75, moving=True)
"""The motion is followed on every step from the 11th on."""
