"""Speed of the environments, beside MuJoCo's and Gymnasium's own vector of single ones."""

from __future__ import annotations

import importlib.util
import time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv

import flag_env  # noqa: F401  registers the ids
from flag_env.studies.speed_rows import Row
from flag_env.studies.timing import fastest

STEPS = 75


def _episode(env: Any, steps: int) -> Any:
    """A job: `steps` steps of random actions, with resets where episodes end."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(steps)]

    def job() -> None:
        env.reset(seed=0)
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if np.ndim(terminated) == 0 and (terminated or truncated):
                env.reset()

    return job


def one_environment(quick: bool) -> list[Row]:
    """Steps per second of `Flag-v0`, and what a step spends outside the machine code of the physics."""
    env = gymnasium.make("Flag-v0")
    jobs = {"Flag-v0": _episode(env, STEPS)}
    if importlib.util.find_spec("mujoco") is not None:
        jobs |= {name: _episode(gymnasium.make(name), STEPS) for name in ("Ant-v5", "HalfCheetah-v5")}
    speed = {name: STEPS / seconds for name, seconds in fastest(jobs, 5 if quick else 10).items()}
    ours = speed["Flag-v0"]
    note = ", ".join(f"{name} {steps:.0f}" for name, steps in speed.items()) + " steps/s"
    bar, aim = (speed["Ant-v5"], max(speed["Ant-v5"], speed["HalfCheetah-v5"] / 2)) if len(speed) > 1 else (0.0, 0.0)
    rows = [
        Row("Flag-v0, one environment", "steps/s", ours, bar, aim, note=note if bar else "gymnasium[mujoco] is not installed")
    ]
    return [*rows, _overhead(env.unwrapped, quick)]


def _overhead(env: Any, quick: bool) -> Row:
    """The physics' machine code is timed inside the very steps that it is a part of; what the timer takes is left out.

    Of stretches of 200 steps, the quickest counts.
    """
    simulator, inner = env.simulator, []
    env.reset(seed=0)
    env.step(env.action_space.sample())
    entry = simulator.run.entry

    def timed(*arguments: Any) -> Any:
        start = time.perf_counter()
        result = entry(*arguments)
        inner.append(time.perf_counter() - start)
        return result

    simulator.run.entry = timed
    whole = []
    action = env.action_space.sample()
    for _ in range(200 * (1 if quick else 15)):
        start = time.perf_counter()
        env.step(action)
        whole.append(time.perf_counter() - start)
    simulator.run.entry = entry
    entry, timer = int, []  # an entry that does nothing
    for _ in range(2000):
        start = time.perf_counter()
        timed()
        timer.append(time.perf_counter() - start - inner.pop())
    steps, physics = (np.reshape(times, (-1, 200)) for times in (whole, inner))
    quietest = np.argmin(np.median(steps, axis=1))
    step = steps[quietest]
    outside = step - physics[quietest] - np.median(timer)
    share = float(100 * np.median(outside / step))
    note = f"{1e6 * np.median(outside):.1f} of {1e6 * np.median(step):.1f} us a step"
    return Row("step outside the kernel", "%", share, 15.0, 8.0, less=True, note=note)


def vector_environment(quick: bool) -> list[Row]:
    """64 flags on two threads, beside `SyncVectorEnv` of the same and of HalfCheetah-v5."""
    count, steps = 64, 10 if quick else 20
    native: Any = gymnasium.make_vec("Flag-v0", count, vectorization_mode="vector_entry_point", threads=2)
    jobs = {
        "native": _episode(native, steps),
        "singles": _episode(SyncVectorEnv([lambda: gymnasium.make("Flag-v0")] * count), steps),
    }
    if importlib.util.find_spec("mujoco") is not None:
        jobs["cheetahs"] = _episode(SyncVectorEnv([lambda: gymnasium.make("HalfCheetah-v5")] * count), steps)
    speed = {name: count * steps / seconds for name, seconds in fastest(jobs, 2 if quick else 10).items()}
    note = f"{speed['native']:.0f} against {speed['singles']:.0f} steps/s"
    rows = [
        Row("64 flags, vector environment, 2 threads", "x SyncVectorEnv", speed["native"] / speed["singles"], 3.0, 3.0, note=note)
    ]
    if "cheetahs" in speed:
        ratio = speed["native"] / speed["cheetahs"]
        note = f"{speed['native']:.0f} against {speed['cheetahs']:.0f} steps/s"
        rows.append(Row("the same against 64 HalfCheetah-v5", "x HalfCheetah-v5", ratio, 1.0, 1.0, note=note))
    return rows


def frames(quick: bool) -> list[Row]:
    """A frame of 480 x 480 pixels of a flag in motion, the median over an episode; of some episodes, the quickest counts."""
    env = gymnasium.make("Flag-v0", render_mode="rgb_array")
    medians = []
    for _ in range(1 if quick else 2):
        env.reset(seed=0)
        env.action_space.seed(0)
        times = []
        for _ in range(STEPS - 1):
            env.step(env.action_space.sample())
            start, spent = time.perf_counter(), time.process_time()
            env.render()
            times.append((time.perf_counter() - start, time.process_time() - spent))
        medians.append(np.median(times, axis=0))
    env.close()
    wall, processor = 1e3 * min(medians, key=lambda median: median[0])
    note = f"{processor:.2f} ms of processor time"
    return [Row("a frame, 480 x 480", "ms", float(wall), 6.0, 3.0, less=True, note=note)]
