"""Episodes as a differentiable function of their actions: actuators, physics, distances and rewards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.control import CONTROL_STEP
from flag_env.envs.batch import FlagBatch
from flag_env.envs.config import EPISODE_STEPS, FlagConfig
from flag_env.physics import Rollout
from flag_env.tasks import REWARD_SLOPES

Array = NDArray[np.float64]


class DifferentiableEpisodes:
    """Episodes of many flags, with the derivatives of what they come to with respect to all actions.

    The flags move as in the environments, to the bit. The scene must be smooth, as for `Rollout`.

    Parameters
    ----------
    config
        The task.
    copies
        Number of flags.
    threads
        As for `Simulator`.

    Attributes
    ----------
    shape
        Of actions: (steps, copies, size).
    distance : (steps, copies)
        Distances to the targets after each step of the last episode, in flag diagonals.
    """

    def __init__(self, config: FlagConfig, copies: int = 1, threads: int | None = None) -> None:
        self._batch = FlagBatch(config, copies, threads=threads)
        self._control = config.control_type
        if not self._control.has_derivatives:
            raise ValueError(f"control must define drive and drive_back to be differentiated, got {config.control!r}")
        self._rollout = Rollout(self._batch.scene, copies, threads=threads, parameters=())
        self.shape = (EPISODE_STEPS, copies, self._control.size)
        self.distance = np.zeros((0, copies))
        self.begin([0] * copies)

    def begin(self, targets: Sequence[int]) -> None:
        """Let the following episodes have these targets of the split, one for each flag, with their hidden winds."""
        batch = self._batch
        batch.reset(range(batch.copies), targets)
        self._targets = batch.frames_of(targets)
        self._before = batch.distance.copy()
        self._rollout.start = batch.simulator.get_state()
        self.distance = np.zeros((0, batch.copies))

    def run(self, actions: ArrayLike) -> Array:
        """Distances after each step, (steps, copies), of an episode from the start under actions of `shape`.

        Fewer steps than an episode has are taken as its beginning.
        """
        given = np.asarray(actions, np.float64)
        _, copies, size = self.shape
        self._actions = np.array(_validate.array("actions", given, (len(given) if given.ndim else 0, copies, size)))
        self._rollout.run(seconds=len(given) * CONTROL_STEP, **self._control.drive(self._batch.scene, self._actions))
        self._apart = self._rollout.path - (self._targets[: len(given)] if len(self._targets) > 1 else self._targets)
        square = (self._apart**2).sum(axis=(2, 3, 4, 5))
        self.distance = np.sqrt(square / self._batch.scene.lattice.size) / self._batch.diagonal
        return self.distance

    def pull_back(self, by_distance: ArrayLike) -> Array:
        """Derivatives of a loss with respect to the actions of the last episode, from those with respect to its distances."""
        given = _validate.array("by_distance", by_distance, self.distance.shape)
        square = self._batch.scene.lattice.size * self._batch.diagonal**2 * np.maximum(self.distance, np.finfo(np.float64).tiny)
        gradient = self._rollout.pull_back((given / square)[..., None, None, None, None] * self._apart)
        return self._control.drive_back(self._batch.scene, self._actions, gradient)

    def pull_back_rewards(self, reward: str, by_reward: ArrayLike) -> Array:
        """The same from derivatives with respect to the rewards of each step; a bonus for being near adds nothing to them.

        Raises
        ------
        ValueError
            If the reward has no derivative.
        """
        _validate.choice("reward", reward, REWARD_SLOPES)
        given = _validate.array("by_reward", by_reward, self.distance.shape)
        before, after = REWARD_SLOPES[reward]
        by_distance = after * given
        by_distance[:-1] += before * given[1:]
        return self.pull_back(by_distance)
