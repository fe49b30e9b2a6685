"""A training so small that it takes seconds."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from training.train import Arguments

PPO = """
Flag-v0:
  n_timesteps: !!float 512
  policy: MlpPolicy
  n_envs: 2
  n_steps: 64
  batch_size: 64
  n_epochs: 2
  learning_rate: lin_1e-3
  policy_kwargs: "dict(log_std_init=-0.5, net_arch=[16, 16], activation_fn=nn.ReLU)"
"""

SAC = """
Flag-v0:
  n_timesteps: 240
  policy: MlpPolicy
  n_envs: 2
  buffer_size: 240
  learning_starts: 100
  batch_size: 16
  policy_kwargs: "dict(net_arch=[16, 16])"
"""


@pytest.fixture
def tiny(tmp_path: Path) -> Callable[..., Arguments]:
    """Function that gives the arguments of a tiny training; keywords replace its arguments."""

    def arguments(algo: str = "ppo", output: str = "runs", **changed: Any) -> Arguments:
        path = tmp_path / f"{algo}.yml"
        path.write_text({"ppo": PPO, "sac": SAC}[algo], encoding="utf-8")
        small = {"validations": 2, "validation_episodes": 2, "evaluation_episodes": 3, "record": False, "progress": False}
        return Arguments(**{"algo": algo, "hyperparameters": path, "output": tmp_path / output, **small, **changed})

    return arguments
