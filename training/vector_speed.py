"""Times PPO on `FlagSB3VecEnv` beside PPO on SB3's `DummyVecEnv`, to the end: `python -m training.vector_speed`.

Both see the same flags to the bit, so both must end with the same network; whether they do is told too. Each has a process, and
they take turns of one rollout and its updates, of which only one runs at a time: what else the machine does slows both alike.
What a step of one flag takes, in microseconds, is measured for the environments alone, for the rollouts (environments, policy and
SB3's bookkeeping), and for the whole training (rollouts and updates of the networks, which know nothing of environments).
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor
from tqdm import tqdm

from flag_env import _validate
from flag_env._files import check_file, machine, write_json
from flag_env.studies.report import table as markdown
from training import hyperparameters
from training.environments import Task, learning_envs
from training.evaluate import evaluate
from training.hyperparameters import FOLDER
from training.rollouts import Agent
from training.train import LARGEST_SEED

TASK = Task()

MAKERS: dict[str, Callable[[int], VecEnv]] = {
    "FlagSB3VecEnv": lambda count: learning_envs(TASK, count, "train"),
    "DummyVecEnv": lambda count: DummyVecEnv([lambda: TASK.make("train")] * count),
}

ALONE = 5
"""Turns of the environments alone."""


@dataclass(frozen=True)
class Arguments:
    """Arguments of the comparison."""

    hyperparameters: Path = FOLDER / "ppo.yml"
    """Hyperparameter file in rl-zoo3's format."""
    total_timesteps: int | None = None
    """Steps of all environments together. None: as many as the hyperparameters say."""
    seed: int = 0
    """Seed of both trainings."""
    results: Path = Path(__file__).parent / "results" / "vector_speed.json"
    """JSON file to write."""

    def __post_init__(self) -> None:
        if self.total_timesteps is not None:
            _validate.count("total_timesteps", self.total_timesteps)
        _validate.count("seed", self.seed, 0, LARGEST_SEED)
        hyperparameters.read(self.hyperparameters, TASK.env_id)
        check_file("results", self.results, (".json",))


class Turns(BaseCallback):
    """Waits for a turn before each rollout, and sends what the turn took: rollout, and rollout with updates [s]."""

    def __init__(self, parent: Connection) -> None:
        super().__init__()
        self._parent = parent
        self._start: float | None = None

    def _on_rollout_start(self) -> None:
        self._end()
        self._parent.recv()
        self._start = time.perf_counter()

    def _on_rollout_end(self) -> None:
        self._sampled = time.perf_counter()

    def _on_training_end(self) -> None:
        self._end()

    def _on_step(self) -> bool:
        return True

    def _end(self) -> None:
        if self._start is not None:
            self._parent.send((self._sampled - self._start, time.perf_counter() - self._start))


def work(parent: Connection, name: str, arguments: Arguments) -> None:
    """One side: the turns of the environments alone, those of the training, and at the end its success and its network."""
    torch.set_num_threads(1)
    hyper = hyperparameters.read(arguments.hyperparameters, TASK.env_id, arguments.total_timesteps)
    envs = MAKERS[name](hyper.n_envs)
    model = PPO(hyper.policy, VecMonitor(envs), seed=arguments.seed, device="cpu", **hyper.keywords())
    alone(envs, arguments.seed)  # compile
    parent.send((model.n_steps * hyper.n_envs, -(-hyper.total_timesteps // (model.n_steps * hyper.n_envs))))
    for _ in range(ALONE):
        parent.recv()
        parent.send(alone(envs, arguments.seed))
    parent.recv()  # learning begins with a reset, and the other side may still have a turn to take
    parent.send("ready")
    model.learn(hyper.total_timesteps, Turns(parent))
    envs.close()
    parent.recv()  # the other side may still have a turn to take
    success = evaluate({"agent": Agent(model)}, TASK, "validation")["policies"]["agent"]
    network = torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach()
    parent.send((success, network.numpy()))


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


def compare(arguments: Arguments) -> dict[str, Any]:
    """The content of the results file."""
    context = multiprocessing.get_context("spawn")  # nothing inherited: each side starts alike
    sides, processes = {}, []
    for name in MAKERS:
        sides[name], child = context.Pipe()
        processes.append(context.Process(target=work, args=(child, name, arguments)))
        processes[-1].start()
        child.close()
    try:
        return _turns(sides, arguments)
    finally:
        for process in processes:
            process.terminate()
            process.join()


def _turns(sides: dict[str, Connection], arguments: Arguments) -> dict[str, Any]:
    def turn(name: str) -> Any:
        sides[name].send("go")
        return sides[name].recv()

    (samples, count), *_ = [side.recv() for side in sides.values()]
    apart = np.array([[turn(name) for name in sides] for _ in range(ALONE)])
    for name in sides:
        turn(name)
    turns = np.array([[turn(name) for name in sides] for _ in tqdm(range(count))]) / samples
    parts = {"environments alone": apart, "rollouts": turns[:, :, 0], "whole training": turns[:, :, 1]}
    ends = {name: turn(name) for name in sides}
    return {
        "machine": machine(),
        "hyperparameters": arguments.hyperparameters.name,
        "seed": arguments.seed,
        "timesteps": count * samples,
        "rows": [{"": part, **_row(list(sides), seconds)} for part, seconds in parts.items()],
        "seconds": dict(zip(sides, (turns[:, :, 1].sum(0) * samples).round(1).tolist(), strict=True)),
        "success": {name: success for name, (success, _) in ends.items()},
        "same network": len({network.tobytes() for _, network in ends.values()}) == 1,
    }


def _row(names: list[str], seconds: np.ndarray) -> dict[str, float]:
    """Microseconds a step of one flag takes on each side, and their ratio: over all turns, and in the quickest turn of each."""
    row: dict[str, float] = {}
    for turns, of_them in (("mean", seconds.mean(0)), ("quickest", seconds.min(0))):
        ours, theirs = (1e6 * of_them).tolist()
        row |= {f"{names[0]}, {turns}": ours, f"{names[1]}, {turns}": theirs, f"ratio, {turns}": theirs / ours}
    return row


def main() -> None:
    """Train and tell how long it took."""
    arguments = tyro.cli(Arguments, description=__doc__)
    result = compare(arguments)
    write_json(arguments.results, result)
    print(markdown(result["rows"]))
    print(markdown([{"": name, "s": result["seconds"][name], **result["success"][name]} for name in MAKERS]))
    print(f"{result['timesteps']} steps, same network: {result['same network']}")


if __name__ == "__main__":
    main()
