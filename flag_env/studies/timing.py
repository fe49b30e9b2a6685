"""Timing of jobs against each other."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

K = TypeVar("K")


def fastest(jobs: dict[K, Callable[[], Any]], rounds: int, prepare: dict[K, Callable[[], Any]] | None = None) -> dict[K, float]:
    """Shortest time of each job [s], the jobs taking turns so that all see the same machine.

    What `prepare` holds for a job is called before each of its runs and not timed.
    """
    best = dict.fromkeys(jobs, float("inf"))
    for turn in range(rounds + 1):
        for name, job in jobs.items():
            if prepare:
                prepare[name]()
            start = time.perf_counter()
            job()
            if turn:  # the first turn compiles
                best[name] = min(best[name], time.perf_counter() - start)
    return best
