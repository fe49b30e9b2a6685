"""Films a trained agent on four targets it has never seen: `python -m training.record runs/Flag-v0-ppo-0`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from flag_env import _validate, viewer
from flag_env._files import check_file
from flag_env.envs.config import EPISODE_STEPS
from flag_env.render import LARGEST_SIZE, SMALLEST_SIZE, write_video
from training.command import refusals
from training.environments import Task
from training.evaluate import load
from training.rollouts import Agent, Policy

PAUSE = 8
"""Frames for which the last picture stands."""


def frames(
    policy: Policy, task: Task, split: str, targets: Sequence[int], size: int = 300, every: int = 2
) -> Iterator[NDArray[np.uint8]]:
    """Pictures of four episodes side by side, 2 x 2, one picture for `every` steps; `size` is the width of one [pixels]."""
    envs = [task.make(split, render_mode="rgb_array", width=size, height=size) for _ in targets]
    policy.begin(np.asarray(targets))
    observations = [env.reset(options={"target": int(target)})[0] for env, target in zip(envs, targets, strict=True)]
    picture = _grid([env.render() for env in envs])
    yield picture
    for step in range(1, EPISODE_STEPS + 1):
        actions = policy.act(np.stack(observations))
        observations = [env.step(action)[0] for env, action in zip(envs, actions, strict=True)]
        if step % every == 0 or step == EPISODE_STEPS:
            picture = _grid([env.render() for env in envs])
            yield picture
    for env in envs:
        env.close()
    for _ in range(PAUSE):
        yield picture


def record(
    path: Path,
    policy: Policy,
    task: Task,
    split: str = "test",
    targets: Sequence[int] = (0, 1, 2, 3),
    every: int = 2,
    size: int = 300,
) -> Path:
    """Write the film as a GIF or MP4, after the suffix of `path`; it plays at the speed of life.

    Raises
    ------
    ValueError
        If an argument is of no use; nothing has been done then.
    """
    check(path, every, size)
    check_targets(task, split, targets)
    fps = task.make(split).metadata["render_fps"] / every
    return write_video(frames(policy, task, split, targets, size, every), path, fps)


def replay(path: Path, policy: Policy, task: Task, split: str = "test", target: int = 0) -> Path:
    """Write an episode as an HTML file that opens anywhere."""
    policy.begin(np.asarray([target]))
    return viewer.save(viewer.of_episode(_shown(task, split), "agent", target, _acting(policy)), path)


def watched(run: Path) -> tuple[viewer.Task, viewer.Act]:
    """What the viewer needs of a finished training: its task, on the test split, and how its agent acts.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no finished training.
    """
    task, model = load(run)
    return _shown(task, "test"), _acting(Agent(model))


def _shown(task: Task, split: str) -> viewer.Task:
    return viewer.Task(task.control, task.level, task.env_id, split, task.accuracy)


def _acting(policy: Policy) -> viewer.Act:
    return lambda observation: policy.act(observation).reshape(-1)


def check(path: Path, every: int, size: int) -> None:
    """Raise a ValueError unless a film can be made with these arguments, of any task."""
    check_file("output", path, (".gif", ".mp4"))
    _validate.count("every", every)
    _validate.count("size", size, SMALLEST_SIZE, LARGEST_SIZE)


def check_targets(task: Task, split: str, targets: Sequence[int]) -> None:
    """Raise a ValueError unless these are four targets of a split of the task."""
    _validate.choice("split", split, task.sizes)
    if len(targets) != 4:
        raise ValueError(f"targets must be four numbers, got {len(targets)}")
    for target in targets:
        _validate.count("targets", target, 0, task.sizes[split] - 1)


def _grid(pictures: list[Any]) -> NDArray[np.uint8]:
    """Four pictures, 2 x 2, with a thin line between them."""
    height, width, _ = pictures[0].shape
    grid = np.full((2 * height + 2, 2 * width + 2, 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        top, left = number // 2 * (height + 2), number % 2 * (width + 2)
        grid[top : top + height, left : left + width] = picture
    return grid


def main(
    run: Annotated[Path, tyro.conf.Positional],
    targets: tuple[int, int, int, int] = (0, 1, 2, 3),
    split: str = "test",
    output: Path | None = None,
    size: int = 300,
    every: int = 2,
) -> None:
    """Film a trained agent on four targets.

    Args:
        run: folder of a finished training; only the weights of its model are loaded.
        targets: numbers of the targets in their split.
        split: where the targets are from.
        output: file to write, .gif or .mp4; agent.gif in the folder if not given.
        size: width of one of the four pictures in pixels.
        every: steps between two pictures.
    """
    torch.set_num_threads(1)
    with refusals():
        path = output or run / "agent.gif"
        check(path, every, size)
        task, model = load(run)
        check_targets(task, split, targets)
    print(record(path, Agent(model), task, split, targets, every, size))


if __name__ == "__main__":
    tyro.cli(main)
