"""Success of agents and baselines on every target of a split: `python -m training.evaluate runs/Flag-v0-ppo-0`.

Of a model, only the weights are read. A `model.zip` also holds pickled objects, and unpickling runs whatever code its author put
there: `PPO.load` and `SAC.load` do it, this does not. The network is built from the hyperparameters in `arguments.json`, which
are read as values, and PyTorch loads its weights with `weights_only`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
import tyro
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.save_util import load_from_zip_file

from flag_env import _validate
from flag_env._files import check_file, read_json, write_json
from flag_env.tasks import SPLITS
from training.baselines import BASELINES
from training.command import refusals
from training.environments import Task, evaluation_envs, learning_envs
from training.hyperparameters import Hyperparameters
from training.rollouts import TOLERANCES, Agent, Policy, rollout, summary

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC}

WIDTH = 64
"""Environments that an evaluation runs in lock-step."""


def evaluate(policies: dict[str, Policy], task: Task, split: str, episodes: int | None = None) -> dict[str, Any]:
    """The content of `evaluation.json`: each policy's summary over the first `episodes` targets of a split (None: all)."""
    size = task.sizes[_validate.choice("split", split, task.sizes)]
    targets = range(size if episodes is None else _validate.count("episodes", episodes, 1, size))
    envs = evaluation_envs(task, min(WIDTH, len(targets)), split)
    results = {name: summary(rollout(policy, envs, targets), task.goal) for name, policy in policies.items()}
    envs.close()
    return {
        "task": vars(task),
        "split": split,
        "episodes": len(targets),
        "tolerances": TOLERANCES,
        "hold_steps": task.goal.steps,
        "policies": results,
    }


def table(evaluation: dict[str, Any]) -> str:
    """An evaluation for the terminal."""
    title = f"{evaluation['task']['env_id']}, {evaluation['task']['control']}, {evaluation['task']['level']}"
    lines = [
        f"{title}: {evaluation['episodes']} {evaluation['split']} targets",
        f"{'policy':12}  {'success at 5 %':>14}  {'success at 3 %':>14}  {'median distance':>15}",
    ]
    for name, result in evaluation["policies"].items():
        median = "diverged" if result["median_distance"] is None else f"{100 * result['median_distance']:.1f} %"
        lines.append(f"{name:12}  {result['success_5']:>14.1%}  {result['success_3']:>14.1%}  {median:>15}")
    return "\n".join(lines)


def load(folder: Path) -> tuple[Task, BasePolicy]:
    """Task and trained policy of a finished training; no stored code is run."""
    if not all((folder / name).exists() for name in ("arguments.json", "model.zip")):
        raise FileNotFoundError(f"a run must be a folder of a finished training, with arguments.json and model.zip, got {folder}")
    description = read_json(folder / "arguments.json")
    arguments, hyper = description["arguments"], Hyperparameters(**description["hyperparameters"])
    task = Task(*(arguments[name] for name in ("env_id", "control", "level", "accuracy")))
    algorithm = ALGORITHMS[arguments["algo"]]
    _, weights, _ = load_from_zip_file(folder / "model.zip", load_data=False, device="cpu")
    envs = learning_envs(task, 1, "validation")
    kind = algorithm.policy_aliases[hyper.policy]
    policy = kind(envs.observation_space, envs.action_space, lambda _: 0.0, **hyper.keywords().get("policy_kwargs", {}))
    envs.close()
    state: Any = weights["policy"]
    policy.load_state_dict(state)
    policy.set_training_mode(False)
    return task, policy


def main(
    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = (),
    baselines: tuple[str, ...] = ("zero", "random"),
    control: str = "wind",
    level: str = "breeze",
    split: str = "validation",
    accuracy: Literal["fast", "balanced", "reference"] | float | None = None,
    output: Path | None = None,
) -> None:
    """Evaluate trained agents and baselines on every target of a split.

    Args:
        runs: folders of finished trainings, all of one task; only their weights are loaded.
        baselines: baselines to evaluate beside them.
        control: control of the baselines' task if there is no run.
        level: level of the baselines' task if there is no run.
        split: targets to evaluate on.
        accuracy: of the simulation that is evaluated on; the one trained on if not given.
        output: JSON file to write as well.
    """
    torch.set_num_threads(1)
    with refusals():
        _validate.choice("split", split, SPLITS)
        for name in baselines:
            _validate.choice("baselines", name, BASELINES)
        if output is not None:
            check_file("output", output, (".json",))
        if len({folder.name for folder in runs}) < len(runs):
            raise ValueError(f"runs must have names that differ, got {', '.join(map(str, runs))}")
        if not runs and not baselines:
            raise ValueError("runs and baselines must name at least one policy, got none")
        loaded = {folder.name: load(folder) for folder in runs}
    tasks = {task if accuracy is None else replace(task, accuracy=accuracy) for task, _ in loaded.values()}
    tasks = tasks or {Task(control=control, level=level, accuracy=Task.accuracy if accuracy is None else accuracy)}
    if len(tasks) > 1:
        raise SystemExit(f"runs must be of one task, got {', '.join(sorted(task.name for task in tasks))}")
    task = tasks.pop()
    policies: dict[str, Policy] = {name: Agent(model) for name, (_, model) in loaded.items()}
    with refusals():
        policies |= {name: BASELINES[name](task, split) for name in baselines}
    result = evaluate(policies, task, split)
    if output is not None:
        write_json(output, result)
    print(table(result))


if __name__ == "__main__":
    tyro.cli(main)
