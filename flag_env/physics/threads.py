"""Threads that wait for work, and survive forks and pickling."""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

Tasks = SimpleQueue[tuple[Callable[[int], Any], int] | None]
Results = SimpleQueue[tuple[int, Any, BaseException | None]]


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Runs a function once in each of `count` threads; kernels release the GIL.

    Two bare queues: an executor's futures take 20 us longer to hand over, two in a hundred of a step of 64 flags.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: tuple[int, Tasks, Results] | None = None

    def run(self, function: Callable[[int], Any], count: int) -> list[Any]:
        """Call `function(i)` for i < count, at once, and return what they return; one call stays in this thread.

        Raises what a call raises, after all have ended.
        """
        if count == 1:
            return [function(0)]
        tasks, results = self._queues()
        for i in range(1, count):
            tasks.put((function, i))
        try:
            first = function(0)
        finally:
            others = sorted((results.get() for _ in range(1, count)), key=lambda other: other[0])
        for _, _, error in others:
            if error is not None:
                raise error
        return [first, *(value for _, value, _ in others)]

    def _queues(self) -> tuple[Tasks, Results]:
        """Those of this process: threads that were made before a fork do not exist in the child."""
        if self._pool is None or self._pool[0] != os.getpid():
            tasks: Tasks = SimpleQueue()
            results: Results = SimpleQueue()
            for _ in range(1, self.count):
                threading.Thread(target=_work, args=(tasks, results), name="flag_env", daemon=True).start()
            weakref.finalize(self, _dismiss, tasks, self.count - 1)
            self._pool = os.getpid(), tasks, results
        return self._pool[1:]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}


def _work(tasks: Tasks, results: Results) -> None:
    while (task := tasks.get()) is not None:
        function, i = task
        try:
            value, error = function(i), None
        except BaseException as raised:
            value, error = None, raised
        del function, task  # or who waits for work would keep alive whom it waits for
        results.put((i, value, error))
        del value, error


def _dismiss(tasks: Tasks, threads: int) -> None:
    for _ in range(threads):
        tasks.put(None)
