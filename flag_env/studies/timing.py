"""Timing of jobs against each other."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

K = TypeVar("K")


def fastest(
    jobs: dict[K, Callable[[], Any]],
    rounds: int,
    prepare: dict[K, Callable[[], Any]] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[K, float]:
    """Shortest time of each job [s], the jobs taking turns so that all see the same machine.

    What `prepare` holds for a job is called before each of its runs and not timed. `clock` tells the time: of jobs on one thread
    `time.process_time` does not count what else the machine is doing.
    """
    best = dict.fromkeys(jobs, float("inf"))
    for turn in range(rounds + 1):
        for name, job in jobs.items():
            if prepare:
                prepare[name]()
            start = clock()
            job()
            if turn:  # the first turn compiles
                best[name] = min(best[name], clock() - start)
    return best
