"""What the simulation's accuracy costs an agent, and saves it: `python -m training.accuracy_cost`.

Trains an agent at each accuracy and evaluates every one of them at every accuracy, on the same targets. Each accuracy leads the
witnesses to slightly other poses, which are its targets. Runs that are finished already are taken as they are, and unfinished
ones are resumed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro
from tqdm import tqdm

from flag_env._files import check_file, machine, read_json, write_json
from flag_env.studies import report
from flag_env.studies.timing import fastest
from training.baselines import Zero
from training.benchmark import check_seeds
from training.environments import Task, evaluation_envs
from training.evaluate import evaluate, load
from training.rollouts import Agent
from training.train import Arguments, run

Accuracy = Literal["fast", "balanced", "reference"]


@dataclass(frozen=True)
class Comparison:
    """Arguments of a comparison."""

    training: tyro.conf.OmitArgPrefixes[Arguments]
    """The training to repeat; its accuracy and seed are replaced."""
    trained_on: tuple[Accuracy, ...] = ("fast", "balanced")
    """Accuracies to train at."""
    evaluated_on: tuple[Accuracy, ...] = ("fast", "balanced", "reference")
    """Accuracies to evaluate at."""
    seeds: tuple[int, ...] = (0,)
    """Seeds to train with."""
    results: Path = Path(__file__).parent / "results" / "accuracy_cost.json"
    """JSON file to write."""

    def __post_init__(self) -> None:
        check_seeds(self.seeds)
        for name in ("trained_on", "evaluated_on"):
            if not getattr(self, name):
                raise ValueError(f"{name} must be one or more accuracies, got none")
        check_file("results", self.results, (".json",))


def compare(arguments: Comparison) -> dict[str, Any]:
    """Train, evaluate and return the content of the results file."""
    agents: list[tuple[dict[str, Any], Any]] = []
    for accuracy in arguments.trained_on:
        for seed in arguments.seeds:
            training = replace(arguments.training, accuracy=accuracy, seed=seed)
            training = replace(training, resume=(training.folder / "arguments.json").exists() and not training.overwrite)
            seconds = run(training)["seconds"]
            agents.append(({"trained on": accuracy, "seed": seed, "training [s]": seconds}, Agent(load(training.folder)[1])))
    task = arguments.training.task
    agents.append(({"trained on": "zero policy", "seed": None, "training [s]": None}, Zero(task, "validation")))
    rows = []
    bar = tqdm(total=len(agents) * len(arguments.evaluated_on), desc="evaluation")
    for accuracy in arguments.evaluated_on:
        for about, policy in agents:
            result = evaluate({"agent": policy}, replace(task, accuracy=accuracy), "validation")
            rows.append({**about, "evaluated on": accuracy, **result["policies"]["agent"]})
            bar.update()
    bar.close()
    example = read_json(training.folder / "arguments.json")
    return {
        "task": {name: value for name, value in vars(task).items() if name != "accuracy"},
        "split": "validation",
        "episodes": result["episodes"],
        "tolerances": result["tolerances"],
        "rows": rows,
        "speed": speeds(task, arguments.evaluated_on),
        "hyperparameters": example["hyperparameters"],
        "machine": machine(),
    }


def speeds(task: Task, accuracies: tuple[Accuracy, ...], count: int = 16, steps: int = 20) -> dict[str, float]:
    """Steps per second of a vector environment of `count` flags at each accuracy, all flags together."""

    def job(accuracy: Accuracy) -> Any:
        envs = evaluation_envs(replace(task, accuracy=accuracy), count, "train")
        envs.reset(seed=0, options={"target": 0})
        actions = np.zeros_like(envs.action_space.sample())
        return lambda: [envs.step(actions) for _ in range(steps)]

    times = fastest({accuracy: job(accuracy) for accuracy in accuracies}, rounds=15)
    return {accuracy: count * steps / seconds for accuracy, seconds in times.items()}


def table(result: dict[str, Any]) -> str:
    """The results for the terminal: one row an agent and accuracy."""
    rows = []
    for row in result["rows"]:
        median = row["median_distance"]
        rows.append(
            {
                "trained on": row["trained on"],
                "seed": "" if row["seed"] is None else row["seed"],
                "training": "" if row["training [s]"] is None else f"{row['training [s]']:.0f} s",
                "evaluated on": row["evaluated on"],
                "success at 5 %": f"{row['success_5']:.1%}",
                "success at 3 %": f"{row['success_3']:.1%}",
                "median distance": "diverged" if median is None else f"{median:.1%}",
            }
        )
    speed = ", ".join(f"{name} {value:,.0f}" for name, value in result["speed"].items())
    return f"{report.table(rows)}\n\nsteps per second of 16 flags: {speed}"


def main() -> None:
    """Parse the command line, compare and write the figures."""
    arguments = tyro.cli(Comparison, description=__doc__)
    torch.set_num_threads(1)
    result = compare(arguments)
    write_json(arguments.results, result)
    print(f"{table(result)}\n\n{arguments.results}")


if __name__ == "__main__":
    main()
