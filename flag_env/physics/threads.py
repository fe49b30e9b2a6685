"""A pool of threads that survives forks and pickling."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Runs a function once in each of `count` threads; kernels release the GIL."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    def run(self, function: Callable[[int], Any], count: int) -> list[Any]:
        """Call `function(i)` for i < count, at once, and return what they return; one call stays in this thread."""
        if count == 1:
            return [function(0)]
        others = [self._executor().submit(function, i) for i in range(1, count)]
        return [function(0), *(other.result() for other in others)]

    def _executor(self) -> ThreadPoolExecutor:
        """Threads of this process: a pool that was made before a fork does not exist in the child."""
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = os.getpid(), ThreadPoolExecutor(self.count - 1, thread_name_prefix="flag_env")
        return self._pool[1]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}
