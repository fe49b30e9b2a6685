"""Measures every rung of the ladder of levels: `flag-env difficulty`.

For each rung: how near test targets are to training targets, and the success of policies that learn nothing (no action, random
actions, the nearest and the best of the 20 nearest training witnesses, a controller of the mast, planners) and of PPO with the
shipped settings; the witness succeeds on every target. What is in the results file already is not measured again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env._files import check_file, machine, read_json, write_json
from flag_env.tasks import rungs
from training.baselines import BASELINES, Lookup, neighbours
from training.environments import Task, evaluation_envs
from training.evaluate import WIDTH
from training.planner import Planner
from training.rollouts import Policy, rollout, summary

RESULTS = Path(__file__).parent / "results" / "difficulty.json"
SPLIT = "test"
NEAREST = 20
CHEAP = ("zero", "random", "p_control", "witness")
"""Baselines that need no search."""


@dataclass(frozen=True)
class Difficulty:
    """Arguments of the measurement."""

    output: Path = RESULTS
    """JSON file to write; what it holds already is kept."""
    only: tuple[str, ...] = ()
    """control/level of the rungs to measure, such as wind/wave. None: all."""
    targets: int = 128
    """Test targets of each policy."""
    planned: int = 16
    """Test targets of the planners, which search for seconds on each."""
    ppo: bool = True
    """Train PPO, in runs/, and evaluate it."""
    quick: bool = False
    """Eight targets, two of the planners, no training."""

    def __post_init__(self) -> None:
        check_file("output", self.output, (".json",))
        known = ["/".join(rung) for rung in rungs()]
        for name in self.only:
            _validate.choice("only", name, known)
        _validate.count("targets", self.targets, 1, 128)
        _validate.count("planned", self.planned, 1, 128)

    @property
    def rungs(self) -> list[tuple[str, str]]:
        """Control and level of what is to be measured."""
        return [rung for rung in rungs() if not self.only or "/".join(rung) in self.only]


def measure(arguments: Difficulty) -> dict[str, Any]:
    """Measure what is missing, the cheapest of every rung first, keep each figure as soon as it is there, and return all."""
    found: dict[str, Any] = read_json(arguments.output) if arguments.output.exists() else {}
    found |= {"machine": machine(), "split": SPLIT}
    table = found.setdefault("rungs", {})
    for control, level in arguments.rungs:
        table.setdefault(f"{control}/{level}", {})
    stages = (_cheap, _planned) if arguments.quick or not arguments.ppo else (_cheap, _planned, _ppo)
    for stage in stages:
        for control, level in arguments.rungs:
            row = table[f"{control}/{level}"]
            for name, value in stage(Task(control=control, level=level), arguments, row):
                row[name] = value
                write_json(arguments.output, found)
    return found


Figures = Iterator[tuple[str, dict[str, Any]]]


def _cheap(task: Task, arguments: Difficulty, row: dict[str, Any]) -> Figures:
    """How near targets are, and baselines that plan nothing."""
    count = 8 if arguments.quick else arguments.targets
    if "nearest" not in row:
        yield "nearest", _nearest(task)
    for name in CHEAP:
        if name not in row and (name != "p_control" or task.control_type.mast_pose is not None):
            yield name, _score(BASELINES[name](task, SPLIT), task, count)
    if f"lookup_{NEAREST}" not in row:
        runs = [_distances(Lookup(task, SPLIT, rank), task, count) for rank in range(NEAREST)]
        yield "lookup", {**summary(runs[0], task.goal), "targets": count}
        yield f"lookup_{NEAREST}", {**summary(_best(runs, task), task.goal), "targets": count}


def _planned(task: Task, arguments: Difficulty, row: dict[str, Any]) -> Figures:
    """The planners; one that knows nothing of hidden winds where there are any."""
    for name in ("planner", "planner_blind"):
        if name not in row and (name == "planner" or task.targets(SPLIT).wind.any()):
            planner = Planner(task, SPLIT, blind=name == "planner_blind")
            yield name, _score(planner, task, 2 if arguments.quick else arguments.planned)


def _ppo(task: Task, arguments: Difficulty, row: dict[str, Any]) -> Figures:
    """PPO, trained in runs/."""
    if "ppo" not in row:
        yield "ppo", _trained(task, arguments.targets)


def _nearest(task: Task) -> dict[str, float]:
    """Distances of test targets to the nearest training target, in diagonals: least and median; share within 5 %."""
    distance = neighbours(task, SPLIT, 1)[1][:, 0]
    return {"least": float(distance.min()), "median": float(np.median(distance)), "within_5": float((distance < 0.05).mean())}


def _distances(policy: Policy, task: Task, count: int) -> NDArray[np.float64]:
    envs = evaluation_envs(task, min(WIDTH, count), SPLIT)
    try:
        return rollout(policy, envs, range(count))
    finally:
        envs.close()


def _score(policy: Policy, task: Task, count: int) -> dict[str, Any]:
    return {**summary(_distances(policy, task, count), task.goal), "targets": count}


def _best(runs: list[NDArray[np.float64]], task: Task) -> NDArray[np.float64]:
    """Of each target, the run that stays nearest on the steps that count."""
    worst = np.stack([run[:, -task.goal.steps :].max(axis=1) for run in runs])
    return np.asarray(np.stack(runs)[worst.argmin(axis=0), np.arange(worst.shape[1])])


def _trained(task: Task, count: int) -> dict[str, Any]:
    """Success of PPO with the settings that are shipped for the task; goes on with a training that was stopped."""
    from training.evaluate import load
    from training.rollouts import Agent
    from training.train import Arguments, run

    training = Arguments(control=task.control, level=task.level, record=False, progress=False, evaluation_episodes=8)
    started = (training.folder / "arguments.json").exists()
    told = run(Arguments(**{**vars(training), "resume": started}))
    score = _score(Agent(load(training.folder)[1]), task, count)
    return {**score, "timesteps": told["timesteps"], "seconds": told["seconds"], "seed": training.seed}
