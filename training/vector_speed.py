"""Times PPO on `FlagSB3VecEnv` beside PPO on SB3's `DummyVecEnv`: `python -m training.vector_speed`.

Both see the same flags to the bit, so both must end with the same network; whether they do is told too. A training consists of
rollouts, in which environments and policy take turns, and of updates of the networks, which know nothing of environments. Three
ratios are measured: of the environments alone, of the rollouts, and of the whole training. Each is the best of some runs.
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
from training.files import write_json

ROLLOUT = 2048
"""Steps of a rollout, of all environments together."""

Maker = Callable[[int], VecEnv]


@dataclass(frozen=True)
class Arguments:
    """Arguments of the comparison."""

    counts: tuple[int, ...] = (16, 64)
    """Numbers of environments."""
    timesteps: int = 5 * ROLLOUT
    """Steps of all environments together, for each training."""
    rounds: int = 3
    """Trainings of each kind, in turn; the shortest times count."""
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


def train(envs: VecEnv, hyper: hyperparameters.Hyperparameters, arguments: Arguments) -> tuple[dict[str, float], torch.Tensor]:
    """Seconds of a training's parts, and its network's parameters in one row."""
    rng = np.random.default_rng(arguments.seed)
    actions = rng.uniform(-1, 1, (40, envs.num_envs, 3)).astype(np.float32)
    envs.seed(arguments.seed)
    envs.reset()
    start = time.perf_counter()
    for action in actions:
        envs.step(action)
    alone = (time.perf_counter() - start) * arguments.timesteps / (len(actions) * envs.num_envs)
    keywords = {**hyper.keywords(), "n_steps": ROLLOUT // envs.num_envs}
    model = PPO(hyper.policy, VecMonitor(envs), seed=arguments.seed, device="cpu", **keywords)
    rollouts = Rollouts()
    start = time.perf_counter()
    model.learn(arguments.timesteps, rollouts)
    whole = time.perf_counter() - start
    envs.close()
    parameters = torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach()
    return {"environments alone": alone, "rollouts": rollouts.seconds, "whole training": whole}, parameters


def compare(count: int, arguments: Arguments) -> dict[str, Any]:
    """A row: steps/s of each part on both, and their ratios."""
    hyper, task = hyperparameters.read(hyperparameters.FOLDER / "ppo.yml", "Flag-v0"), Task()
    makers: dict[str, Maker] = {
        "FlagSB3VecEnv": lambda count: learning_envs(task, count, "train"),
        "DummyVecEnv": lambda count: DummyVecEnv([lambda: task.make("train")] * count),
    }
    best: dict[str, dict[str, float]] = {}
    networks = []
    for _ in tqdm(range(arguments.rounds), desc=f"{count} environments"):
        for name, make in makers.items():
            seconds, network = train(make(count), hyper, arguments)
            known = best.setdefault(name, seconds)
            best[name] = {part: min(known[part], seconds[part]) for part in seconds}
            networks.append(network)
    ours, theirs = best.values()
    row: dict[str, Any] = {"environments": count}
    for part in ours:
        row |= {
            f"{part}, steps/s": round(arguments.timesteps / ours[part]),
            f"{part}, DummyVecEnv": round(arguments.timesteps / theirs[part]),
            f"{part}, times as fast": theirs[part] / ours[part],
        }
    return row | {"same network": all(torch.equal(networks[0], network) for network in networks)}


def main() -> None:
    """Train and tell how long it took."""
    arguments = tyro.cli(Arguments, description=__doc__)
    torch.set_num_threads(1)
    task = Task()
    for envs in (learning_envs(task, 1, "train"), task.make("train")):  # compile
        envs.reset()
        envs.step(np.zeros((1, 3) if isinstance(envs, VecEnv) else 3, np.float32))
    rows = [compare(count, arguments) for count in arguments.counts]
    write_json(arguments.results, {"machine": machine(), "timesteps": arguments.timesteps, "rows": rows})
    print(markdown([{"": name, **{str(row["environments"]): row[name] for row in rows}} for name in rows[0]]))


if __name__ == "__main__":
    main()
