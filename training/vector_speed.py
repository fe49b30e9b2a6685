"""Times PPO on `FlagSB3VecEnv` beside PPO on SB3's `DummyVecEnv`: `python -m training.vector_speed`.

Both see the same flags to the bit, so both must end with the same network; whether they do is told too. A training consists of
rollouts, in which environments and policy take turns, and of updates of the networks, which know nothing of environments. Three
ratios are measured for each file of hyperparameters: of the environments alone, of the rollouts, and of the whole training. Each
is that of the best of some short trainings, which take turns. With the last file both are then trained to the end and evaluated.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor
from tqdm import tqdm

from flag_env.studies.report import machine
from flag_env.studies.report import table as markdown
from training import hyperparameters
from training.environments import Task, learning_envs
from training.evaluate import evaluate
from training.files import write_json
from training.hyperparameters import FOLDER, Hyperparameters
from training.rollouts import Agent

TASK = Task()

MAKERS: dict[str, Callable[[int], VecEnv]] = {
    "FlagSB3VecEnv": lambda count: learning_envs(TASK, count, "train"),
    "DummyVecEnv": lambda count: DummyVecEnv([lambda: TASK.make("train")] * count),
}


@dataclass(frozen=True)
class Arguments:
    """Arguments of the comparison."""

    hyperparameters: tuple[Path, ...] = (FOLDER / "ppo.yml", FOLDER / "ppo-many.yml")
    """Hyperparameter files in rl-zoo3's format."""
    timesteps: int = 10_000
    """Steps of all environments together, for each short training; rounded up to whole rollouts."""
    rounds: int = 3
    """Short trainings of each kind, in turn; the shortest times count."""
    to_the_end: bool = True
    """Also train to the end, once on each, with the last of the files."""
    seed: int = 0
    """Seed of all trainings."""
    results: Path = field(default=Path(__file__).parent / "results" / "vector_speed.json")
    """JSON file to write."""


class Rollouts(BaseCallback):
    """Adds up the time of rollouts [s]."""

    def __init__(self) -> None:
        super().__init__()
        self.seconds = 0.0

    def _on_rollout_start(self) -> None:
        self._start = time.perf_counter()

    def _on_rollout_end(self) -> None:
        self.seconds += time.perf_counter() - self._start

    def _on_step(self) -> bool:
        return True


def alone(envs: VecEnv, seed: int) -> float:
    """Seconds that a step of one flag takes without an agent, over some more than an episode."""
    rng = np.random.default_rng(seed)
    actions = rng.uniform(-1, 1, (80, envs.num_envs, 3)).astype(np.float32)
    envs.seed(seed)
    envs.reset()
    start = time.perf_counter()
    for action in actions:
        envs.step(action)
    return (time.perf_counter() - start) / (len(actions) * envs.num_envs)


def train(envs: VecEnv, hyper: Hyperparameters, timesteps: int, seed: int, progress: bool = False) -> tuple[PPO, float, float]:
    """A trained model, and the seconds that its rollouts and the whole training took."""
    model = PPO(hyper.policy, VecMonitor(envs), seed=seed, device="cpu", **hyper.keywords())
    rollouts = Rollouts()
    start = time.perf_counter()
    model.learn(timesteps, rollouts, progress_bar=progress)
    return model, rollouts.seconds, time.perf_counter() - start


def network(model: PPO) -> torch.Tensor:
    """All parameters of a model in one row."""
    return torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach()


def compare(path: Path, arguments: Arguments) -> dict[str, Any]:
    """A row: steps/s of each part on both, and their ratios."""
    hyper = hyperparameters.read(path, TASK.env_id)
    best: dict[str, dict[str, float]] = {name: {} for name in MAKERS}
    networks = []
    for _ in tqdm(range(arguments.rounds), desc=path.name):
        for name, make in MAKERS.items():
            envs = make(hyper.n_envs)
            seconds = {"environments alone": alone(envs, arguments.seed)}
            model, rollouts, whole = train(envs, hyper, arguments.timesteps, arguments.seed)
            envs.close()
            seconds |= {"rollouts": rollouts / model.num_timesteps, "whole training": whole / model.num_timesteps}
            best[name] = {part: min(best[name].get(part, np.inf), value) for part, value in seconds.items()}
            networks.append(network(model))
    ours, theirs = best.values()
    row: dict[str, Any] = {"hyperparameters": path.name, "environments": hyper.n_envs, "timesteps": model.num_timesteps}
    for part in ours:
        row |= {
            f"{part}, steps/s": round(1 / ours[part]),
            f"{part}, DummyVecEnv": round(1 / theirs[part]),
            f"{part}, times as fast": theirs[part] / ours[part],
        }
    return row | {"same network": all(torch.equal(networks[0], other) for other in networks)}


def to_the_end(path: Path, seed: int) -> dict[str, Any]:
    """Times and success of a whole training on both."""
    hyper = hyperparameters.read(path, TASK.env_id)
    seconds, success, networks = {}, {}, []
    for name, make in MAKERS.items():
        print(f"{path.name}, {name}, to the end")
        envs = make(hyper.n_envs)
        model, _, seconds[name] = train(envs, hyper, hyper.total_timesteps, seed, progress=True)
        envs.close()
        success[name] = evaluate({"agent": Agent(model)}, TASK, "validation")["policies"]["agent"]
        networks.append(network(model))
    ours, theirs = seconds.values()
    return {
        "hyperparameters": path.name,
        "timesteps": model.num_timesteps,
        "seed": seed,
        **{name: {"seconds": round(seconds[name], 1), **success[name]} for name in MAKERS},
        "times as fast": theirs / ours,
        "same network": torch.equal(*networks),
    }


def main() -> None:
    """Train and tell how long it took."""
    arguments = tyro.cli(Arguments, description=__doc__)
    torch.set_num_threads(1)
    for envs in (learning_envs(TASK, 1, "train"), TASK.make("train")):  # compile
        envs.reset()
        envs.step(np.zeros((1, 3) if isinstance(envs, VecEnv) else 3, np.float32))
    rows = [compare(path, arguments) for path in arguments.hyperparameters]
    result = {"machine": machine(), "rows": rows}
    if arguments.to_the_end:
        result["to the end"] = to_the_end(arguments.hyperparameters[-1], arguments.seed)
    write_json(arguments.results, result)
    print(markdown([{"": name, **{row["hyperparameters"]: row[name] for row in rows}} for name in rows[0]]))
    if arguments.to_the_end:
        whole = result["to the end"]
        columns = ("seconds", "success_5", "success_3")
        print(markdown([{"to the end": name} | {key: whole[name][key] for key in columns} for name in MAKERS]))
        print(f"{whole['times as fast']:.2f} times as fast, same network: {whole['same network']}")


if __name__ == "__main__":
    main()
