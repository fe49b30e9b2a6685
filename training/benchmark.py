"""Trains an agent with each of several seeds and keeps the figures: `python -m training.benchmark --seeds 0 1 2`.

Runs that are finished already are taken as they are, and unfinished ones are resumed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from flag_env import _validate
from flag_env._files import check_file, read_json, write_json
from training.train import LARGEST_SEED, Arguments, run

RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Benchmark:
    """Arguments of a benchmark."""

    training: tyro.conf.OmitArgPrefixes[Arguments]
    """The training to repeat; its seed is replaced."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds to train with."""
    results: Path | None = None
    """JSON file to write. None: training/results/<control>_<level>_<algo>.json."""

    def __post_init__(self) -> None:
        check_seeds(self.seeds)
        check_file("results", self.path, (".json",))

    @property
    def path(self) -> Path:
        """JSON file to write."""
        training = self.training
        return self.results or RESULTS / f"{training.control}_{training.level}_{training.algo}.json"


def check_seeds(seeds: tuple[int, ...]) -> None:
    """Raise a ValueError unless there are seeds, each of which a training takes, and no two alike."""
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds must be one or more, no two alike, got {seeds}")
    for seed in seeds:
        _validate.count("seeds", seed, 0, LARGEST_SEED)


def benchmark(arguments: Benchmark) -> dict[str, Any]:
    """Train with every seed and return the content of the results file."""
    rows, description = [], {}
    for seed in arguments.seeds:
        training = replace(arguments.training, seed=seed)
        training = replace(training, resume=(training.folder / "arguments.json").exists() and not training.overwrite)
        evaluation = run(training)
        description = read_json(training.folder / "arguments.json")
        run_of_seed = {name: evaluation[name] for name in ("timesteps", "seconds")}
        run_of_seed["seconds_to_95"] = seconds_to(0.95, read_json(training.folder / "learning_curve.json"), **run_of_seed)
        rows.append({"seed": seed, **run_of_seed, **evaluation["policies"]["agent"]})
    names = [name for name in rows[0] if name not in ("seed", "timesteps", "seconds", "seconds_to_95")]
    mean = {name: float(np.mean([row[name] for row in rows])) for name in names if all(row[name] is not None for row in rows)}
    return {
        "task": evaluation["task"],
        "algo": arguments.training.algo,
        "split": evaluation["split"],
        "episodes": evaluation["episodes"],
        "tolerances": evaluation["tolerances"],
        "hold_steps": evaluation["hold_steps"],
        "seeds": rows,
        "mean": mean,
        "baselines": {name: result for name, result in evaluation["policies"].items() if name != "agent"},
        "hyperparameters": description["hyperparameters"],
        "machine": description["machine"],
        "date": datetime.now(UTC).date().isoformat(),
    }


def seconds_to(success: float, curve: list[dict[str, Any]], timesteps: int, seconds: float) -> float | None:
    """Training time until the first point of a learning curve with this success at 5 %, as if all steps took alike; None: never.

    The time holds what validations and checkpoints take.
    """
    reached = [point["timesteps"] for point in curve if point["success_5"] >= success]
    return round(seconds * reached[0] / timesteps, 1) if reached else None


def table(result: dict[str, Any]) -> str:
    """The results for the terminal."""
    lines = [f"{'':8}  {'success at 5 %':>14}  {'success at 3 %':>14}  {'median distance':>15}  {'seconds':>7}  {'to 95 %':>7}"]
    rows = {f"seed {row['seed']}": row for row in result["seeds"]} | {"mean": result["mean"]} | result["baselines"]
    for name, row in rows.items():
        median = row.get("median_distance")
        distance = "diverged" if median is None else f"{median:.1%}"
        seconds = f"{row['seconds']:.0f}" if "seconds" in row else ""
        soon = "never" if row.get("seconds_to_95", 0) is None else f"{row['seconds_to_95']:.0f}" if "seconds_to_95" in row else ""
        lines.append(f"{name:8}  {row['success_5']:>14.1%}  {row['success_3']:>14.1%}  {distance:>15}  {seconds:>7}  {soon:>7}")
    return "\n".join(lines)


def main() -> None:
    """Parse the command line, train and write the figures."""
    arguments = tyro.cli(Benchmark, description=__doc__)
    result = benchmark(arguments)
    write_json(arguments.path, result)
    print(f"{table(result)}\n\n{arguments.path}")


if __name__ == "__main__":
    main()
