"""Times PPO on `FlagSB3VecEnv` beside PPO on SB3's `DummyVecEnv`: `python -m training.vector_speed`.

Both see the same flags to the bit, so both must end with the same network; whether they do is printed too.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor

from training import hyperparameters
from training.environments import Task, learning_envs


@dataclass(frozen=True)
class Arguments:
    """Arguments of the comparison."""

    timesteps: int = 20_000
    """Steps of all environments together, for each of the two."""
    seed: int = 0
    """Seed of both trainings."""


def train(envs: VecEnv, hyper: hyperparameters.Hyperparameters, arguments: Arguments) -> tuple[float, torch.Tensor]:
    """Seconds of a training, and its network's parameters in one row."""
    model = PPO(hyper.policy, VecMonitor(envs), seed=arguments.seed, device="cpu", **hyper.keywords())
    start = time.perf_counter()
    model.learn(arguments.timesteps)
    seconds = time.perf_counter() - start
    envs.close()
    return seconds, torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach()


def main() -> None:
    """Train twice and tell how long each took."""
    arguments = tyro.cli(Arguments, description=__doc__)
    torch.set_num_threads(1)
    hyper = hyperparameters.read(hyperparameters.FOLDER / "ppo.yml", "Flag-v0")
    task = Task()
    first = learning_envs(task, 1, "train")
    first.reset()
    first.step(np.zeros((1, 3)))  # compiles
    singles = DummyVecEnv([lambda: task.make("train")] * hyper.n_envs)
    native, ours = train(learning_envs(task, hyper.n_envs, "train"), hyper, arguments)
    dummy, theirs = train(singles, hyper, arguments)
    print(f"FlagSB3VecEnv {native:.1f} s, DummyVecEnv {dummy:.1f} s: {dummy / native:.2f} times as fast")
    print(f"same network: {torch.equal(ours, theirs)}")


if __name__ == "__main__":
    main()
