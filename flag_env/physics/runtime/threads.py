"""Threads that wait for work, and survive forks and pickling."""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

Done = dict[int, tuple[Any, BaseException | None]]
Tasks = SimpleQueue[tuple[Callable[[int], Any], int, Done, SimpleQueue[None]] | None]


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Runs a function once in each of `count` threads; kernels release the GIL.

    Bare queues hand over: an executor's futures take 20 us longer, two in a hundred of a step of 64 flags.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: tuple[int, Tasks] | None = None

    def run(self, function: Callable[[int], Any]) -> list[Any]:
        """Call `function(i)` for i < count, at once, and return what they return; one call stays in this thread.

        Raises what a call raises, or an interrupt, after all have ended: they work on arrays that the caller goes on to use.
        """
        if self.count == 1:
            return [function(0)]
        tasks, asked = self._tasks(), 0
        done: Done = {}
        wake: SimpleQueue[None] = SimpleQueue()
        error: BaseException | None = None
        try:
            for i in range(1, self.count):
                tasks.put((function, i, done, wake))
                asked += 1
            first = function(0)
        except BaseException as raised:
            error = raised
        while len(done) < asked:  # what has been done counts: an interrupt may swallow a call to wake up
            try:
                wake.get()
            except KeyboardInterrupt as raised:
                error = raised
        error = error or next((other for _, other in done.values() if other is not None), None)
        try:
            if error is not None:
                raise error
        finally:
            del error, function  # a traceback that holds this frame, which holds the traceback, would keep the caller's arrays
        return [first, *(done[i][0] for i in range(1, self.count))]

    def _tasks(self) -> Tasks:
        """The queue of this process: threads that were made before a fork do not exist in the child."""
        if self._pool is None or self._pool[0] != os.getpid():
            tasks = Tasks()
            weakref.finalize(self, _dismiss, tasks, self.count - 1)
            for _ in range(1, self.count):
                threading.Thread(target=_work, args=(tasks,), name="flag_env", daemon=True).start()
            self._pool = os.getpid(), tasks
        return self._pool[1]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}


def _work(tasks: Tasks) -> None:
    while (task := tasks.get()) is not None:
        function, i, done, wake = task
        result: tuple[Any, BaseException | None]
        try:
            result = function(i), None
        except BaseException as error:
            result = None, error
        del function, task  # or who waits for work would keep alive whom it waits for
        done[i] = result
        wake.put(None)
        del done, wake, result


def _dismiss(tasks: Tasks, threads: int) -> None:
    for _ in range(threads):
        tasks.put(None)
