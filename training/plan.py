"""Actions planned by gradients through the simulator: `flag-train plan` solves targets whose hidden wind is known.

A planner knows the simulator, the whole target pose and its wind, more than any agent does: what it reaches bounds what can be
learnt, and its actions are witnesses for targets that come without.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from tqdm import tqdm

from flag_env import _validate
from flag_env._files import check_file, machine, write_json
from flag_env.envs.config import FlagConfig
from training.command import refusals
from training.planning import METHODS, Plan, Planner


def summary(plans: list[Plan], goal: float) -> dict[str, Any]:
    """What one method's plans come to."""
    distances, seconds = np.array([plan.distance for plan in plans]), np.array([plan.seconds for plan in plans])
    return {
        "targets": len(plans),
        "reached": float((distances < goal).mean()),
        "median distance": float(np.median(distances)),
        "worst distance": float(distances.max()),
        "median seconds": float(np.median(seconds)),
        "slowest 1 % seconds": float(np.quantile(seconds, 0.99)),
        "median episodes": float(np.median([plan.evaluations for plan in plans])),
    }


def plan(config: FlagConfig, targets: int, goal: float, seconds: float, threads: int, methods: tuple[str, ...]) -> dict[str, Any]:
    """Plans of the first targets by each method: their summaries, and the actions of the first method."""
    planner = Planner(config, goal, seconds, threads)
    found = {name: [METHODS[name](planner, target) for target in tqdm(range(targets), desc=name)] for name in methods}
    return {name: summary(plans, goal) for name, plans in found.items()}


def main(
    control: Literal["wind", "mast"] = "wind",
    level: Literal["calm", "breeze"] = "breeze",
    split: Literal["train", "validation", "test"] = "validation",
    targets: int | None = None,
    goal: float = 0.03,
    seconds: float = 0.5,
    threads: int = 1,
    methods: tuple[Literal["gradient", "cross-entropy"], ...] = ("gradient", "cross-entropy"),
    output: Path | None = None,
) -> None:
    """Plan episodes with known hidden wind, by gradients and for comparison by cross-entropy.

    Args:
        control: control of the task.
        level: level of the task.
        split: targets to plan for.
        targets: how many of them, the first ones; all if not given.
        goal: distance to stay within on the last 10 steps, in flag diagonals.
        seconds: processor time for each target.
        threads: threads to simulate in.
        methods: planners.
        output: JSON file to write as well.
    """
    with refusals():
        if output is not None:
            check_file("output", output, (".json",))
        _validate.number("goal", goal, above=0.0)
        _validate.number("seconds", seconds, above=0.0)
        _validate.count("threads", threads)
        config = FlagConfig(control=control, level=level, split=split)
        held = len(config.library)
        count = held if targets is None else _validate.count("targets", targets, 1, held)
    result = plan(config, count, goal, seconds, threads, methods)
    if output is not None:
        write_json(output, {"machine": machine(), "task": [control, level, split], "goal": goal, "seconds": seconds, **result})
    for name, row in result.items():
        print(f"{name:14} " + ", ".join(f"{key} {value:.3g}" for key, value in row.items()))


if __name__ == "__main__":
    tyro.cli(main)
