"""Tables of the environment pages, read off the environments themselves."""

from __future__ import annotations

import inspect
import re
from typing import Any

import gymnasium
import numpy as np

import flag_env  # noqa: F401  registers the ids
from docs._generate.markdown import code, percent, table
from flag_env.control import CONTROLS, MastControl, WindControl
from flag_env.envs.batch import LEVELS, FlagConfig
from flag_env.envs.flag import FlagEnv
from flag_env.envs.goal import FlagGoalEnv
from flag_env.tasks import REWARDS, SIZES, SPLITS, load_targets

IDS = ("Flag-v0", "FlagGoal-v0", "FlagGoalDense-v0")
AXES = ("x", "y", "z")
_FULL, _SPEED = WindControl.gain, MastControl.speed
ACTIONS = {
    "wind": [(f"amplitude of the wind along {axis}", f"{most:g} m/s²") for axis, most in zip(AXES, _FULL, strict=True)],
    "mast": [
        *((f"velocity of the mast along {axis}", f"{most:g} m/s") for axis, most in zip(AXES, _SPEED[:3], strict=True)),
        *((f"tilt rate of the mast about {axis}", f"{most:g} rad/s") for axis, most in zip(AXES[:2], _SPEED[3:], strict=True)),
    ],
}
"""Meaning of each entry of an action, and what 1 stands for."""

STATES = {"wind": "amplitude of the wind", "mast": "pose, then velocity of the mast"}
"""What an agent sees of each control's actuators."""


def pages() -> dict[str, str]:
    """Tables of spaces, rewards, arguments, levels and what `info` holds."""
    found = {f"header_{env_id}.md": header(env_id) for env_id in IDS}
    found |= {f"action_{control}.md": actions(control) for control in CONTROLS}
    found |= {f"observation_{control}.md": observation(control) for control in CONTROLS}
    found |= {f"arguments_{env_id}.md": arguments(env_id) for env_id in IDS}
    return found | {"goal_spaces.md": goal_spaces(), "rewards.md": rewards(), "info.md": info(), "targets.md": targets()}


def header(env_id: str) -> str:
    """The table that opens a page: spaces, step, length, how it is made."""
    spec, env = gymnasium.spec(env_id), gymnasium.make(env_id)
    space = env.observation_space
    shown = (
        "<br>".join(f"`{key}: {_box(value)}`" for key, value in space.items())
        if isinstance(space, gymnasium.spaces.Dict)
        else code(_box(space))
    )
    rate = env.metadata["render_fps"]
    rows = [
        ["Action space", code(_box(env.action_space))],
        ["Observation space", shown],
        ["Control step", f"{1 / rate:g} s; {spec.max_episode_steps} steps an episode"],
        ["Render modes", ", ".join(code(mode) for mode in env.metadata["render_modes"])],
        ["Make one", code(f'gymnasium.make("{env_id}")')],
        ["Make many", code(f'gymnasium.make_vec("{env_id}", num_envs=64, vectorization_mode="vector_entry_point")')],
    ]
    env.close()
    return table(["", f"{env_id}, control wind"], rows)


def _box(space: Any) -> str:
    return f"Box({space.low.min():g}, {space.high.max():g}, {space.shape}, {space.dtype})"


def actions(control: str) -> str:
    """Entries of an action."""
    meanings = ACTIONS[control]
    if len(meanings) != CONTROLS[control].size:
        raise ValueError(f"the page must tell of {CONTROLS[control].size} entries of an action of {control}, not {len(meanings)}")
    rows = [[i, f"set-point of the {what}", most] for i, (what, most) in enumerate(meanings)]
    return table(["entry", "what", "at full action"], rows)


def observation(control: str) -> str:
    """Entries of a flat observation, checked against an environment in motion."""
    env = FlagEnv(control)
    env.reset(seed=0)
    seen = env.step(np.ones(env.action_space.shape, np.float32))[0]
    batch = env._batch
    shown = 3 * len(batch.nodes)
    now, target = (np.asarray(value).reshape(-1, 3)[batch.nodes].ravel() for value in (env.simulator.positions, env.target))
    velocity = env.simulator.velocities.reshape(-1, 3)[batch.nodes].ravel()
    scale, state = batch.control.error_scale * batch.diagonal, batch.control.state[0]
    layout = [
        ("positions of the nodes: x, y, z of each, row by row from below", "m", now),
        ("their velocities", "m/s", velocity),
        ("target positions of the nodes", "m", target),
        ("target minus position", f"{batch.control.error_scale:g} flag diagonals", (target - now) / scale),
        (f"actuators: {STATES[control]}", "share of its range", state),
        ("time left", "share of the episode", np.array([1 - 1 / 75])),
    ]
    rows, start = [], 0
    for what, unit, value in layout:
        end = start + len(value)
        if not np.allclose(seen[start:end], value, atol=2e-4):
            raise ValueError(f"entries {start} to {end - 1} of an observation under {control} control are not {what}")
        rows.append([f"{start} to {end - 1}" if len(value) > 1 else start, len(value), what, unit])
        start = end
    if env.observation_space.shape != (start,):
        raise ValueError(f"the page tells of {start} entries, the observation has the shape {env.observation_space.shape}")
    return f"{shown // 3} nodes:\n\n" + table(["entries", "number", "what", "unit"], rows)


def goal_spaces() -> str:
    """Keys of a goal environment's observation."""
    meaning = {
        "observation": "positions and velocities of the nodes, actuators, time left",
        "achieved_goal": "positions of the nodes [m]",
        "desired_goal": "their target positions [m]",
    }
    spaces = {control: FlagGoalEnv(control).observation_space for control in CONTROLS}
    rows = [
        [code(key), *(spaces[control][key].shape[0] for control in CONTROLS), what]
        for key, what in meaning.items()
        if all(key in space.spaces for space in spaces.values())
    ]
    return table(["key", *(f"entries, {control}" for control in CONTROLS), "what"], rows)


def rewards() -> str:
    """Terms of each reward, with an example: from 20 % to 4 % of the diagonal in one step."""
    before, after, tolerance = 0.20, 0.04, 0.05
    rows = [
        [code(f'"{name}"'), code(f"reward_{term}"), f"{float(value):+.3f}"]
        for name, reward in REWARDS.items()
        for term, value in reward(before, after, tolerance).items()
    ]
    return table(["`reward`", "term in `info`", "from d = 20 % to 4 %, tolerance 5 %"], rows)


def info() -> str:
    """What `info` holds after a step."""
    meaning = {
        "distance": "RMS distance of the particles to their targets, in flag diagonals",
        "is_success": "whether the distance has been below `tolerance` on each of the last 10 steps",
        "diverged": "whether the simulation has left the finite numbers; the episode has then terminated",
        "target": "number of the target in its split",
    }
    env = FlagEnv()
    env.reset(seed=0)
    given = env.step(env.action_space.sample())[4]
    told = {key: "a part of the reward" if key.startswith("reward_") else meaning[key] for key in given}
    return table(["key", "type", "what"], [[code(key), code(type(given[key]).__name__), text] for key, text in told.items()])


def arguments(env_id: str) -> str:
    """Keyword arguments of an id with their defaults, and their meaning from the docstring of the environment."""
    kind = gymnasium.spec(env_id).entry_point
    constructor = FlagEnv if kind.endswith(":FlagEnv") else FlagGoalEnv
    meaning = {
        name: text
        for names, _, text in re.findall(r"^ *\| (`\w.*?`) \| (.*?) \| (.*?) \|$", FlagEnv.__doc__, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", names)
    }
    overridden = gymnasium.spec(env_id).kwargs
    rows = []
    for name, parameter in list(inspect.signature(constructor.__init__).parameters.items())[1:]:
        default = overridden.get(name, parameter.default)
        text = f'"sparse" or "dense"; this id is {default}' if name == "reward" and overridden else meaning[name]
        rows.append([code(name), code(repr(default)), text])
    return table(["argument", "default", "meaning"], rows)


def targets() -> str:
    """Sizes of the splits, and how far the targets are from a flag at rest, for every control and level."""
    rows = []
    for control in CONTROLS:
        for level in LEVELS:
            row: list[Any] = [control, level]
            for split in SPLITS:
                library, scene = load_targets(control, level, split), FlagConfig(control, level, split).resolved_scene()
                away = library.positions - scene.lattice.rest_positions
                distance = np.sqrt((away**2).sum(axis=-1).mean(axis=(1, 2, 3))) / scene.lattice.diagonal
                row.append(f"{len(library)}; {percent(float(np.median(distance)), 0)}")
                if len(library) != SIZES[split]:
                    raise ValueError(f"{control}/{level}/{split} holds {len(library)} targets, not {SIZES[split]}")
            rows.append(row)
    return table(["control", "level", *SPLITS], rows)
