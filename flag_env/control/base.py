"""What every control offers."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import Gradient, Scene, Simulator

CONTROL_STEP = 0.04
"""Duration of one action [s]."""

Array = NDArray[np.float64]


class Control:
    """Actuators of many copies of a flag, driven by actions in [-1, 1].

    Attributes
    ----------
    size
        Number of entries of an action.
    state_size
        Number of entries of `state`.
    error_scale
        Difference between target and position that an agent sees as 1, in flag diagonals: of the size that the differences
        have under this control, so that networks are neither saturated nor blind.
    mast_range
        How far along an axis the mast may be from where it stands at the start [m]: what a picture must have space for.
    mast_pose
        Where the mast's pose (x, y, z, about x, about y) stands in `state`; None where the mast stands still.
    has_derivatives
        Whether it defines `drive` and `drive_back`, through which gradients flow.
    state : (copies, state_size)
        What an agent sees of the actuators, about unit-sized; always the same memory.
    """

    size: ClassVar[int]
    state_size: ClassVar[int]
    error_scale: ClassVar[float]
    mast_range: ClassVar[float] = 0.0
    has_derivatives: ClassVar[bool] = False
    mast_pose: ClassVar[slice | None] = None

    def __init__(self, scene: Scene, copies: int) -> None:
        self.check(scene)
        self.state = np.zeros((copies, self.state_size))

    @classmethod
    def check(cls, scene: Scene) -> None:
        """Raise ValueError if the scene lacks what the control acts on."""

    def reset(self, simulator: Simulator, copies: NDArray[np.intp]) -> None:
        """Bring the actuators of these copies to rest."""
        raise NotImplementedError

    def apply(self, simulator: Simulator, actions: NDArray[np.floating[Any]]) -> bool:
        """Move the actuators on by one control step under `actions`, clipped to [-1, 1], and hand the result to the physics.

        `actions` are float32 or float64, copies x size entries in any shape. False, and nothing has moved, unless all are finite.
        """
        raise NotImplementedError

    def mast_share(self, pose: Array) -> Array:
        """Poses of masts (n, 5) as they stand in `state`."""
        raise NotImplementedError

    def get_state(self, copy: int) -> tuple[Array, ...]:
        """What `set_state` brings back: all numbers of one copy's actuators that are not in the simulator."""
        return (self.state[copy].copy(),)

    def set_state(self, copy: int, state: tuple[Array, ...]) -> None:
        """Bring one copy's actuators to where `get_state` of any copy found them."""
        (self.state[copy],) = state

    @classmethod
    def drive(cls, scene: Scene, actions: Array) -> dict[str, Array]:
        """What `apply` hands to the physics from rest on, as the argument that `Rollout.run` takes it by.

        Parameters
        ----------
        actions : (steps, copies, size)
            Clipped to [-1, 1].
        """
        raise NotImplementedError(f"{cls.__name__} must define drive(scene, actions) to be differentiated")

    @classmethod
    def drive_back(cls, scene: Scene, actions: Array, gradient: Gradient) -> Array:
        """Derivatives with respect to the actions, from those of a rollout with respect to what `drive` returns.

        Where an action is clipped, or an actuator at its stop, they are those of a thing at rest: zero.
        """
        raise NotImplementedError(f"{cls.__name__} must define drive_back(scene, actions, gradient) to be differentiated")

    @staticmethod
    def sample_witness(rng: np.random.Generator, steps: int) -> Array:
        """A random sequence of actions (steps, size) that ends with the flag coming to rest."""
        raise NotImplementedError

    @staticmethod
    def alternative_actions(actions: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Other ways to where `actions` (steps, size) lead: a pose that all reach does not depend on one path's folds."""
        raise NotImplementedError


def lag_factor(lag: float) -> float:
    """Share of the way to its set-point that a first-order actuator of time constant `lag` [s] goes in one control step."""
    return 1.0 - math.exp(-CONTROL_STEP / lag)


def clipped_share(actions: Array) -> Array:
    """One where an action counts, zero where it is clipped."""
    return (np.abs(actions) <= 1.0).astype(np.float64)


def hold(levels: Any, lengths: tuple[int, ...], steps: int) -> Array:
    """Piecewise constant actions (steps, size): each level for its length, the last one to the end."""
    counts = (*lengths, steps - sum(lengths))
    return np.repeat(np.asarray(levels, np.float64), counts, axis=0)
