"""Threads that wait for work, and survive forks and pickling."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Runs a function once in each of `count` threads; kernels release the GIL."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    def run(self, function: Callable[[int], Any]) -> list[Any]:
        """Call `function(i)` for i < count, at once, and return what they return; one call stays in this thread.

        Raises what a call raises, or an interrupt, after all have ended: they work on arrays that the caller goes on to use.
        """
        if self.count == 1:
            return [function(0)]
        executor = self._executor()
        others: list[Future[Any]] = []
        try:
            for i in range(1, self.count):
                others.append(executor.submit(function, i))
            first = function(0)
        finally:
            _wait_for_all(others)
        return [first, *(other.result() for other in others)]

    def _executor(self) -> ThreadPoolExecutor:
        """The executor of this process: threads that were made before a fork do not exist in the child."""
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = os.getpid(), ThreadPoolExecutor(self.count - 1, thread_name_prefix="flag_env")
        return self._pool[1]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}


def _wait_for_all(futures: list[Future[Any]]) -> None:
    """Return once all have ended; an interrupt is raised after that."""
    interrupt: KeyboardInterrupt | None = None
    while not all(future.done() for future in futures):
        try:
            wait(futures)
        except KeyboardInterrupt as raised:
            interrupt = raised
    if interrupt is not None:
        raise interrupt
