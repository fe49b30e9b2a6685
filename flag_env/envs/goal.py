"""The goal environments, `FlagGoal-v0` (sparse) and `FlagGoalDense-v0`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import NDArray

from flag_env.control import Control
from flag_env.envs.flag import FlagEnv
from flag_env.envs.views import GoalView, goal_reward
from flag_env.physics import Scene
from flag_env.tasks import Level, Targets


class FlagGoalEnv(FlagEnv):
    """`FlagEnv` with a dictionary observation, for hindsight experience replay.

    ## Observation space

    | key | entries | what | unit |
    |---|---|---|---|
    | `achieved_goal` | 45 | positions of 3 x 5 nodes | m |
    | `desired_goal` | 45 | their target positions | m |
    | `observation` | 90 + 3 or 10 + 1 | positions and velocities of the nodes, actuators, time left | m, m/s, shares |

    ## Rewards

    With d = RMS distance of the nodes to their targets / flag diagonal: "sparse" (`FlagGoal-v0`) gives -1 for d >= tolerance,
    else 0; "dense" (`FlagGoalDense-v0`) gives -d. `compute_reward` gives the same numbers from the two goals alone, of one or
    many transitions. `info` measures the whole flag, as in `FlagEnv`; actions, start, end and all other arguments are those of
    `FlagEnv`.
    """

    view: ClassVar[type[GoalView]] = GoalView
    _view: GoalView

    def __init__(
        self,
        control: str | type[Control] = "wind",
        level: str | Level = "breeze",
        split: str = "train",
        scene: Scene | str | None = None,
        tolerance: float = 0.05,
        reward: str | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        accuracy: str | float | None = None,
        targets: Targets | str | Path | None = None,
        view: str | None = None,
    ) -> None:
        super().__init__(control, level, split, scene, tolerance, reward, render_mode, width, height, accuracy, targets, view)

    def compute_reward(self, achieved_goal: NDArray[Any], desired_goal: NDArray[Any], info: Any) -> Any:
        """Reward of having reached `achieved_goal` when asked for `desired_goal`.

        Parameters
        ----------
        achieved_goal, desired_goal : (..., 45)
            Positions of the nodes [m].
        info
            Not used.

        Returns
        -------
        float or array (...)
            The rewards.
        """
        return goal_reward(self._view, achieved_goal, desired_goal)
