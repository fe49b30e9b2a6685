"""What is asked of an agent: target poses that are known to be reachable, and rewards."""

from flag_env.tasks.reward import REWARDS
from flag_env.tasks.targets import PARTS, SIZES, SPLITS, Targets, decode, digest, encode, load_targets, read_seed, read_targets

__all__ = [
    "PARTS", "REWARDS", "SIZES", "SPLITS", "Targets", "decode", "digest", "encode", "load_targets", "read_seed", "read_targets",
]  # fmt: skip
