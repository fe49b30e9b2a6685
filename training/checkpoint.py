"""Checkpoints: everything that the continuation of a training depends on, in one file.

A checkpoint holds the model with its optimizer, the environments in mid-episode, the states of all random generators and what the
callbacks have gathered, so that a resumed training ends with the same bits as one that was never interrupted. It is a pickle:
loading one runs code, so resume only your own trainings.
"""

from __future__ import annotations

import io
import pickle
import random
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecMonitor

from flag_env._files import write_bytes

KEPT = 2
"""Checkpoints that stay; the older ones are removed."""


def save(folder: Path, model: BaseAlgorithm, gathered: dict[str, Any]) -> Path:
    """Write a checkpoint between two rollouts."""
    monitor = model.get_env()
    assert isinstance(monitor, VecMonitor)
    stored = io.BytesIO()
    model.save(stored)
    content = {
        "model": stored.getvalue(),
        "replay_buffer": model.replay_buffer if isinstance(model, OffPolicyAlgorithm) else None,
        "envs": monitor.venv,
        "monitor": {name: vars(monitor)[name] for name in ("episode_returns", "episode_lengths", "episode_count")},
        "random": (random.getstate(), np.random.get_state(), torch.get_rng_state(), model.action_space.np_random),  # noqa: NPY002
        "gathered": gathered,
    }
    path = folder / f"{model.num_timesteps:09d}.checkpoint"
    write_bytes(path, pickle.dumps(content))
    for old in paths(folder)[:-KEPT]:
        old.unlink()
    return path


def paths(folder: Path) -> list[Path]:
    """The checkpoints of a training, oldest first."""
    return sorted(folder.glob("*.checkpoint"))


def load(folder: Path, algorithm: type[BaseAlgorithm], device: str) -> tuple[BaseAlgorithm, dict[str, Any]] | None:
    """Model, and what the callbacks had gathered, of the newest checkpoint that can be read; None if there is none.

    Raises
    ------
    ValueError
        If there are checkpoints, but none that can be read.
    """
    found = paths(folder)
    for path in reversed(found):
        try:
            content = pickle.loads(path.read_bytes())
        except Exception as error:  # a damaged pickle may raise anything
            warnings.warn(f"{path} cannot be read ({error!r}); trying the one before it", stacklevel=2)
            continue
        return restore(content, algorithm, device), content["gathered"]
    if found:
        raise ValueError(f"none of the {len(found)} checkpoints in {folder} can be read; begin anew with --overwrite")
    return None


def restore(content: dict[str, Any], algorithm: type[BaseAlgorithm], device: str) -> BaseAlgorithm:
    """The model as it was, in its environments as they were; sets the global random generators."""
    monitor = VecMonitor(content["envs"])
    vars(monitor).update(content["monitor"])
    # Without force_reset=False the environments would start anew.
    model = algorithm.load(io.BytesIO(content["model"]), env=monitor, device=device, force_reset=False)
    if isinstance(model, OffPolicyAlgorithm):
        model.replay_buffer = content["replay_buffer"]
    state, numpy_state, torch_state, actions = content["random"]  # after the load, which seeds the generators
    random.setstate(state)
    np.random.set_state(numpy_state)  # noqa: NPY002
    torch.set_rng_state(torch_state)
    model.action_space._np_random = actions
    return model
