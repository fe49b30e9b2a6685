"""How long an episode is.

Gymnasium ends episodes in a wrapper, `TimeLimit`, and does not tell the environment inside when; an agent that is told the time
left must be told the right one. A wrapper that resets an environment stands in the call stack: there it is found.
"""

from __future__ import annotations

import inspect
from typing import Any

import gymnasium
from gymnasium.wrappers import TimeLimit


def time_limit(env: gymnasium.Env[Any, Any]) -> int | None:
    """Steps that the wrappers through which `env` is being reset allow it, the fewest if several do; None if none does."""
    limits = []
    frame = inspect.currentframe()
    while frame is not None:
        wrapper = frame.f_locals.get("self")
        if isinstance(wrapper, TimeLimit) and wrapper.unwrapped is env:
            limits.append(wrapper._max_episode_steps)
        frame = frame.f_back
    return min(limits, default=None)
