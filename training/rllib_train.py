"""Trains PPO with RLlib, on one machine or a cluster: `python -m training.rllib_train`.

For whoever outgrows one machine: each env runner is a process with a native vector environment of its own, and steps/s grow with
their number. Needs the extra "distributed": pip install -e ".[distributed]". The folder of a run receives `checkpoint/`, RLlib's
own format, after each iteration, and `progress.jsonl`, a line each. A checkpoint holds pickles, and loading one runs code: resume
only trainings of your own.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from flag_env import _validate
from flag_env._files import check_folder
from flag_env.control import CONTROLS
from flag_env.tasks import checked_level
from training.lock import held

LEARNING_RATE = 2e-3
MINIBATCH = 400


@dataclass(frozen=True)
class Arguments:
    """Arguments of a training."""

    control: str = "wind"
    """What the agent acts on: "wind" or "mast"."""
    level: str = "breeze"
    """Difficulty: "calm" or "breeze"."""
    runners: int = 2
    """Env runners, each a process with one thread."""
    envs_per_runner: int = 64
    """Flags in the vector environment of each runner."""
    iterations: int = 63
    """Iterations in all, those before a resumption included; the learning rate falls to zero over them."""
    batch: int = 9600
    """Environment steps of one iteration, of all runners together."""
    seed: int = 0
    """Seed of everything random."""
    address: str | None = None
    """Of a running Ray cluster, as ray.init takes it ("auto", "ray://host:10001"); None: a Ray of this machine alone."""
    output: Path = Path("runs/rllib")
    """Folder of the run."""
    resume: bool = False
    """Go on from the folder's checkpoint."""

    def __post_init__(self) -> None:
        _validate.choice("control", self.control, CONTROLS)
        checked_level(self.control, self.level)
        _validate.count("runners", self.runners, 0)
        _validate.count("envs_per_runner", self.envs_per_runner)
        _validate.count("iterations", self.iterations)
        _validate.count("batch", self.batch, MINIBATCH)
        _validate.count("seed", self.seed, 0)
        check_folder("output", self.output)


def config(arguments: Arguments) -> Any:
    """RLlib's configuration: PPO on the new API stack, with what it takes of training/hyperparams/ppo.yml."""
    import gymnasium
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    return (
        PPOConfig()
        .environment("flag_env:Flag-v0", env_config={"control": arguments.control, "level": arguments.level, "threads": 1})
        .env_runners(
            num_env_runners=arguments.runners,
            num_envs_per_env_runner=arguments.envs_per_runner,
            gym_env_vectorize_mode=gymnasium.VectorizeMode.VECTOR_ENTRY_POINT,
        )
        .training(
            train_batch_size_per_learner=arguments.batch, minibatch_size=MINIBATCH, num_epochs=1, gamma=0.98, lambda_=0.95,
            lr=[[0, LEARNING_RATE], [arguments.iterations * arguments.batch, 0.0]],
            entropy_coeff=0.0, clip_param=0.2, vf_clip_param=float("inf"), use_kl_loss=False, grad_clip=0.5,
        )
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=[64, 64], fcnet_activation="relu", vf_share_layers=False, free_log_std=True
            )
        )
        .learners(num_learners=0)
        .debugging(seed=arguments.seed)
    )  # fmt: skip


def _set_learning_rate(algorithm: Any, rate: float) -> None:
    """Replace the rate that a checkpoint brought, zero after a whole training: RLlib reads the schedule after updates only."""

    def of_learner(learner: Any) -> None:
        for name in learner.module.keys():  # noqa: SIM118  not a dict: iterating over it is not said to give names
            for _, optimizer in learner.get_optimizers_for_module(name):
                for group in optimizer.param_groups:
                    group["lr"] = rate

    algorithm.learner_group.foreach_learner(of_learner)


def run(arguments: Arguments) -> dict[str, Any]:
    """Train and return the last line of `progress.jsonl`."""
    os.environ["OMP_NUM_THREADS"] = "1"  # runners are processes: more threads would contend for the same cores
    try:
        import ray
    except ImportError:
        raise SystemExit('this training needs the extra "distributed": pip install -e ".[distributed]"') from None

    folder = arguments.output.resolve()
    place = folder / "checkpoint"
    if place.exists() and not arguments.resume:
        raise SystemExit(f"{folder} holds a training; go on with --resume, or choose another --output")
    if arguments.address is None:
        ray.init(address="local", num_cpus=max(arguments.runners + 1, 2))  # whatever cluster this machine has been part of
    else:
        ray.init(address=arguments.address)
    algorithm = config(arguments).build_algo()
    holding = ExitStack()
    try:
        holding.enter_context(held(folder))
        if place.exists():
            algorithm.restore_from_path(str(place))
            _set_learning_rate(algorithm, LEARNING_RATE * max(0.0, 1.0 - algorithm.training_iteration / arguments.iterations))
        line: dict[str, Any] = {}
        while algorithm.training_iteration < arguments.iterations:
            start = time.perf_counter()
            result = algorithm.train()
            seconds, sampled = time.perf_counter() - start, result["env_runners"]
            line = {
                "iteration": result["training_iteration"],
                "steps": int(sampled["num_env_steps_sampled_lifetime"]),
                "return": float(sampled.get("episode_return_mean", float("nan"))),
                "seconds": seconds,
                "steps/s": arguments.batch / seconds,
            }
            with (folder / "progress.jsonl").open("a") as file:
                file.write(json.dumps(line) + "\n")
            print(line)
            algorithm.save_to_path(str(place))
        return line
    finally:
        algorithm.stop()
        ray.shutdown()
        holding.close()


if __name__ == "__main__":
    run(tyro.cli(Arguments, description=__doc__))
