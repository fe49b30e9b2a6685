"""Reads hyperparameter files in rl-zoo3's format, as far as these trainings use it."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from stable_baselines3.common.utils import LinearSchedule
from torch import nn

FOLDER = Path(__file__).parent / "hyperparams"


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters of one training.

    Attributes
    ----------
    total_timesteps
        Steps of all environments together.
    n_envs
        Number of environments.
    policy
        Name of the policy.
    algorithm
        The algorithm's own arguments, as the file has them.
    """

    total_timesteps: int
    n_envs: int
    policy: str
    algorithm: dict[str, Any]

    def keywords(self) -> dict[str, Any]:
        """Keyword arguments for the algorithm's constructor."""
        keywords = {name: _schedule(value) for name, value in self.algorithm.items()}
        if "policy_kwargs" in keywords:
            keywords["policy_kwargs"] = parse_keywords(keywords["policy_kwargs"])
        return keywords


def shipped(algo: str, control: str) -> Path:
    """The file of an algorithm: the one tuned to the control, where there is one."""
    own = FOLDER / f"{algo}-{control}.yml"
    return own if own.exists() else FOLDER / f"{algo}.yml"


def read(path: Path, env_id: str, total_timesteps: int | None = None, n_envs: int | None = None) -> Hyperparameters:
    """The entry of an environment in a hyperparameter file; numbers that are given take the place of the file's."""
    entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    if env_id not in entries:
        raise ValueError(f"env_id must be one of {', '.join(entries)}, which have hyperparameters in {path}, got {env_id!r}")
    entry = dict(entries[env_id])
    steps, envs = int(entry.pop("n_timesteps")), int(entry.pop("n_envs", 1))
    return Hyperparameters(total_timesteps or steps, n_envs or envs, entry.pop("policy"), entry)


def parse_keywords(text: str) -> dict[str, Any]:
    """Value of "dict(name=value, ...)" with literals and names of torch.nn as values; nothing is executed."""
    call = ast.parse(text, mode="eval").body
    if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "dict" and not call.args):
        raise ValueError(f"policy_kwargs must read dict(name=value, ...), got {text!r}")
    return {str(keyword.arg): _literal(keyword.value) for keyword in call.keywords}


def _literal(node: ast.expr) -> Any:
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "nn":
        return getattr(nn, node.attr)
    if isinstance(node, ast.Call):
        return parse_keywords(ast.unparse(node))
    return ast.literal_eval(node)


def _schedule(value: Any) -> Any:
    """`lin_3e-4` stands for a value that falls linearly to zero."""
    if isinstance(value, str) and value.startswith("lin_"):
        return LinearSchedule(float(value.removeprefix("lin_")), 0.0, 1.0)
    return value
