"""How soon the package is ready, each start in a Python of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from flag_env.studies.speed_rows import Row

_SCRIPT = """
import time
import gymnasium
start = time.perf_counter()
import flag_env
print(time.perf_counter() - start)
env = gymnasium.make("Flag-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.perf_counter() - start)
"""


def starts(quick: bool) -> list[Row]:
    """Import beyond gymnasium; the first step of an environment from the cache and, with an empty one, ever."""
    with tempfile.TemporaryDirectory() as cache:
        first_ever = _start(cache)[1]
        later = [_start(cache) for _ in range(2)]
    imported, step = (min(times[i] for times in later) for i in range(2))
    return [
        Row("import beyond gymnasium", "ms", 1e3 * imported, 50.0, 20.0, less=True),
        Row("first step, from cache", "s", step, 1.5, 1.0, less=True),
        Row("first step ever", "s", first_ever, 20.0, 10.0, less=True),
    ]


def _start(cache: str) -> tuple[float, float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    done = subprocess.run([sys.executable, "-c", _SCRIPT], env=environment, capture_output=True, text=True, check=True)
    imported, step = done.stdout.split()[-2:]
    return float(imported), float(step)
