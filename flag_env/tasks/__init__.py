"""What is asked of an agent: levels, targets that are known to be reachable, and rewards."""

from flag_env.tasks.goals import HOLD, SNAP, WAVE, Goal
from flag_env.tasks.levels import LEVELS, VIEWS, Level, checked_level, rungs
from flag_env.tasks.reward import REWARD_SLOPES, REWARDS
from flag_env.tasks.targets import PARTS, QUANTUM, SPLITS, Targets, decode, digest, encode, load_targets, read_seed, read_targets
from flag_env.tasks.witnesses import Sampler, Spline, Strokes

__all__ = [
    "HOLD",
    "LEVELS",
    "PARTS",
    "QUANTUM",
    "REWARDS",
    "REWARD_SLOPES",
    "SNAP",
    "SPLITS",
    "VIEWS",
    "WAVE",
    "Goal",
    "Level",
    "Sampler",
    "Spline",
    "Strokes",
    "Targets",
    "checked_level",
    "decode",
    "digest",
    "encode",
    "load_targets",
    "read_seed",
    "read_targets",
    "rungs",
]
