"""Reads hyperparameter files in rl-zoo3's format, as far as these trainings use it."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from stable_baselines3.common.utils import LinearSchedule
from torch import nn

from flag_env import _validate

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


def shipped(algo: str, control: str, level: str = "breeze") -> Path:
    """The file of an algorithm: the one tuned to the level or else to the control, where there is one."""
    own = (FOLDER / f"{algo}-{name}.yml" for name in (_KINDS.get(level, level), control))
    return next((path for path in own if path.exists()), FOLDER / f"{algo}.yml")


_KINDS = {"storm": "wave", "whip": "snap", "swing": "snap"}
"""Levels that learn with the settings of another."""


def read(path: Path, env_id: str, total_timesteps: int | None = None, n_envs: int | None = None) -> Hyperparameters:
    """The entry of an environment in a hyperparameter file; numbers that are given take the place of the file's.

    Raises
    ------
    ValueError
        If the file cannot be read, has no entry for the environment, or one that lacks a number or has a bad one.
    """
    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f"hyperparameters must be a YAML file, got {path} ({error})") from error
    if not isinstance(entries, dict) or not isinstance(entries.get(env_id), dict):
        known = ", ".join(map(str, entries)) if isinstance(entries, dict) else "none"
        raise ValueError(f"env_id must be one of {known}, which have hyperparameters in {path}, got {env_id!r}")
    entry = dict(entries[env_id])
    missing = [name for name in ("n_timesteps", "policy") if name not in entry]
    if missing:
        raise ValueError(f"hyperparameters of {env_id} must have {' and '.join(missing)}, got {path} without")
    steps = _whole(f"n_timesteps in {path}", entry["n_timesteps"]) if total_timesteps is None else total_timesteps
    envs = _whole(f"n_envs in {path}", entry.get("n_envs", 1)) if n_envs is None else n_envs
    own = {name: value for name, value in entry.items() if name not in ("n_timesteps", "n_envs", "policy")}
    return Hyperparameters(_validate.count("total_timesteps", steps), _validate.count("n_envs", envs), entry["policy"], own)


def _whole(name: str, value: Any) -> int:
    """A number of a file, which rl-zoo3 writes as 1e6, as a whole one of at least 1."""
    try:
        number = _validate.number(name, value)
        return _validate.count(name, int(number) if number.is_integer() else number)
    except TypeError as error:
        raise ValueError(str(error)) from None


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
