"""Motions for replays and videos: of a stage, of any scene, of an episode."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flag_env.control import CONTROL_STEP
from flag_env.physics import Scene, Simulator
from flag_env.render import Renderer, Snapshot, write_video
from flag_env.viewer.body import body
from flag_env.viewer.episode import Act, Episode, Task
from flag_env.viewer.replay import Motion, Replay
from flag_env.viewer.settings import Settings
from flag_env.viewer.stages import STAGES, start

FPS = 25.0
"""Frames a second of a film."""


def of_stage(name: str, seconds: float = 3.0, fps: float = FPS) -> Motion:
    """A stage as it comes, for `seconds` on the screen."""
    settings = Settings.of(name)
    simulator, stage, breeze = start(settings.scene()), STAGES[name], settings.breeze()
    if breeze is not None:
        simulator.set_wind(breeze.amplitude, breeze.frequency, breeze.mean)
    reach = settings.wind_reach if breeze is not None else None
    return of_simulator(simulator, seconds, fps, title=stage.title, told=stage.told, pace=stage.pace, wind_reach=reach)


def of_scene(scene: Scene, seconds: float = 3.0, fps: float = FPS, title: str = "", told: str = "", seed: int = 0) -> Motion:
    """Any scene from its start."""
    return of_simulator(start(scene, seed), seconds, fps, title=title, told=told)


def of_simulator(
    simulator: Simulator,
    seconds: float = 3.0,
    fps: float = FPS,
    *,
    title: str = "",
    told: str = "",
    pace: float = 1.0,
    wind_reach: float | None = None,
    each: Callable[[Simulator, int], None] | None = None,
) -> Motion:
    """The first copy of a simulator from now on, which moves on with it.

    Parameters
    ----------
    seconds, fps
        Length on the screen, and frames a second of it.
    pace
        Simulated seconds that a second on the screen shows.
    wind_reach
        The wind, in the scene's unit, of an arrow of full length; None: no wind is shown.
    each
        Called with the simulator and the frame's number before each frame is taken: to move the mast, say.
    """
    frames, winds = [], []
    for number in range(max(1, round(seconds * fps))):
        if each is not None:
            each(simulator, number)
        frames.append(simulator.positions[0])
        if wind_reach is not None:
            winds.append(simulator.wind()[0] / wind_reach)  # type: ignore[index]
        simulator.advance(pace / fps)
    wind = np.array(winds) if winds else None
    return Motion(body(simulator.scene), np.array(frames), fps, title, told, pace, wind)


def of_episode(task: Task, driver: str, target: int = 0, agent: Act | None = None) -> Motion:
    """One episode, in real time."""
    episode = Episode(task, driver, target, agent)
    shots: list[Snapshot] = [episode.snapshot()]
    while not episode.done:
        episode.step()
        shots.append(episode.snapshot())
    wind = None if shots[0].wind is None else np.array([shot.wind / shot.wind_scale for shot in shots])  # type: ignore[operator]
    who = {"witness": "the witness", "agent": "a trained agent", "hand": "no action"}[driver]
    told = f"{who}, target {target} of {task.split}, {task.control} control, {task.level}"
    motion = Motion(
        body(episode.env.simulator.scene), np.array([shot.positions for shot in shots]), 1.0 / CONTROL_STEP, task.env_id, told,
        wind=wind, target=shots[0].target, distance=[float(shot.distance or 0.0) for shot in shots],
        tolerance=float(shots[0].tolerance or 0.05),
    )  # fmt: skip
    episode.close()
    return motion


def save(motion: Motion, path: str | os.PathLike[str], size: int = 480) -> Path:
    """Write a motion as a replay (.html) or a video (.gif, .mp4; `size` pixels wide and high), whole or not at all."""
    path = Path(path)
    if path.suffix.lower() == ".html":
        return Replay(motion).save(path)
    return write_video(pictures(motion, size), path, motion.fps)


def pictures(motion: Motion, size: int) -> Iterator[NDArray[np.uint8]]:
    """The frames of a motion, drawn off screen by one camera that holds them all."""
    renderer = Renderer(size, size)
    box = bounds(motion)
    for number, positions in enumerate(motion.frames):
        distance = motion.distance[number] if motion.distance else None
        yield renderer.draw(
            Snapshot(
                positions, positions[0, [0, -1], 0], box, motion.target, None if motion.wind is None else motion.wind[number],
                success=distance is not None and distance < motion.tolerance, distance=distance,
                tolerance=None if distance is None else motion.tolerance,
            )
        )  # fmt: skip
    renderer.close()


def bounds(motion: Motion) -> NDArray[np.float64]:
    """The box that all frames and the target lie in, with some room, (2, 3) [m]; its floor is the ground."""
    points = motion.frames.reshape(-1, 3)
    if motion.target is not None:
        points = np.concatenate([points, motion.target.reshape(-1, 3)])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.12 * float(np.linalg.norm(high - low)) + 1e-6
    return np.stack([low - room, high + room])
