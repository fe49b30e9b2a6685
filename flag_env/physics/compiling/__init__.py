"""How Python kernels become machine code: decorators, the cache of compiled code, and the one compiled step of a scene."""

from flag_env.physics.compiling.back import compiled_back, compiled_record, pull_back
from flag_env.physics.compiling.cache import source_digest
from flag_env.physics.compiling.decorators import WAY, cached, entry_point, inlined, jit, kernel
from flag_env.physics.compiling.disk_cache import cache_root, keep_on_disk, load_from_disk
from flag_env.physics.compiling.step import CHECK_EVERY, compiled_run, first_non_finite, forces, make_run

__all__ = [
    "CHECK_EVERY",
    "WAY",
    "cache_root",
    "cached",
    "compiled_back",
    "compiled_record",
    "compiled_run",
    "entry_point",
    "first_non_finite",
    "forces",
    "inlined",
    "jit",
    "keep_on_disk",
    "kernel",
    "load_from_disk",
    "make_run",
    "pull_back",
    "source_digest",
]
