"""Timing of jobs against each other."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def fastest(jobs: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Shortest time of each job [s], the jobs taking turns so that all see the same machine."""
    best = dict.fromkeys(jobs, float("inf"))
    for turn in range(rounds + 1):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            if turn:  # the first turn compiles
                best[name] = min(best[name], time.perf_counter() - start)
    return best
