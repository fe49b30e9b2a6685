"""Tables of the environment pages, read off the environments themselves."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields
from typing import Any

import gymnasium
import numpy as np

import flag_env  # noqa: F401  registers the ids
from docs._generate.markdown import code, percent, table
from flag_env.control import CONTROLS, MastControl, MastYawControl, WindControl, WindFrequencyControl
from flag_env.envs.config import EPISODE_STEPS, FlagConfig
from flag_env.envs.flag import FlagEnv
from flag_env.envs.goal import FlagGoalEnv
from flag_env.tasks import LEVELS, REWARDS, load_targets

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
ACTIONS["both"] = ACTIONS["wind"] + ACTIONS["mast"]
ACTIONS["wind+frequency"] = ACTIONS["wind"] + [
    (f"angular frequency of the wind along {axis}, from 0 at -1", f"{most:g} rad/s")
    for axis, most in zip(AXES, WindFrequencyControl.fastest, strict=True)
]
ACTIONS["mast+yaw"] = [*ACTIONS["mast"], ("rate of the mast about its own axis", f"{MastYawControl.speed[5]:g} rad/s")]
"""Meaning of each entry of an action, and what 1 stands for."""

OBSERVED = ("wind", "mast")
"""Controls whose observations have a table; those of the others are made of the same parts."""

STATES = {"wind": "amplitude of the wind", "mast": "pose, then velocity of the mast"}
"""What an agent sees of each control's actuators."""


def pages() -> dict[str, str]:
    """Tables of spaces, rewards, arguments, levels and what `info` holds."""
    found = {f"header_{env_id}.md": header(env_id) for env_id in IDS}
    found |= {f"action_{control}.md": actions(control) for control in CONTROLS}
    found |= {f"observation_{control}.md": observation(control) for control in OBSERVED}
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
    now, target = (np.asarray(value).reshape(-1, 3)[batch.nodes].ravel() for value in (env.simulator.positions, env.target))
    velocity = env.simulator.velocities.reshape(-1, 3)[batch.nodes].ravel()
    scale, state = batch.control.error_scale * batch.diagonal, batch.control.state[0]
    told = {
        "positions": ("positions of the nodes: x, y, z of each, row by row from below", "m", now),
        "velocities": ("their velocities", "m/s", velocity),
        "targets": ("target positions of the nodes", "m", target),
        "differences": ("target minus position", f"{batch.control.error_scale:g} flag diagonals", (target - now) / scale),
        "actuators": (f"actuators: {STATES[control]}", "share of its range", state),
        "time_left": ("time left", "share of the episode", np.array([1 - 1 / EPISODE_STEPS])),
    }
    rows = []
    for part in [part for part in fields(batch.layout) if part.name in told]:
        what, unit, value = told[part.name]
        found = getattr(batch.layout, part.name)
        if not np.allclose(seen[found], value, atol=2e-4):
            raise ValueError(f"entries {found} of an observation under {control} control are not {what}")
        entries = f"{found.start} to {found.stop - 1}" if len(value) > 1 else found.start
        rows.append([entries, len(value), code(part.name), what, unit])
    return f"{len(batch.nodes)} nodes:\n\n" + table(["entries", "number", "slice", "what", "unit"], rows)


def goal_spaces() -> str:
    """Keys of a goal environment's observation."""
    meaning = {
        "observation": "positions and velocities of the nodes, actuators, time left",
        "achieved_goal": "positions of the nodes [m]",
        "desired_goal": "their target positions [m]",
    }
    spaces = {control: FlagGoalEnv(control).observation_space for control in OBSERVED}
    rows = [
        [code(key), *(spaces[control][key].shape[0] for control in OBSERVED), what]
        for key, what in meaning.items()
        if all(key in space.spaces for space in spaces.values())
    ]
    return table(["key", *(f"entries, {control}" for control in OBSERVED), "what"], rows)


def rewards() -> str:
    """Terms of each reward, with an example: from 20 % to 4 % of the diagonal in the last step."""
    before, after, tolerance = 0.20, 0.04, 0.05
    rows = [
        [code(f'"{name}"'), code(f"reward_{term}"), f"{float(value):+.3f}"]
        for name, reward in REWARDS.items()
        for term, value in reward(before, after, tolerance, True).items()
    ]
    return table(["`reward`", "term in `info`", "from d = 20 % to 4 % in the last step, tolerance 5 %"], rows)


def info() -> str:
    """What `info` holds after a step."""
    meaning = {
        "distance": "RMS distance of the particles to their targets, in flag diagonals",
        "is_success": "whether the level's goal is reached: of a pose to hold, d < `tolerance` on each of the last 10 steps",
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
    """Sizes of the splits, and how far the targets are from a flag at rest, for every control and level that ships poses."""
    rows = []
    for name in ("calm", "breeze"):
        for control in LEVELS[name].controls:
            row: list[Any] = [control, name]
            for split, size in LEVELS[name].sizes.items():
                library, scene = load_targets(control, name, split), FlagConfig(control, name, split).resolved_scene()
                away = library.positions - scene.lattice.rest_positions
                distance = np.sqrt((away**2).sum(axis=-1).mean(axis=(1, 2, 3))) / scene.lattice.diagonal
                row.append(f"{len(library)}; {percent(float(np.median(distance)), 0)}")
                if len(library) != size:
                    raise ValueError(f"{control}/{name}/{split} holds {len(library)} targets, not {size}")
            rows.append(row)
    return table(["control", "level", *LEVELS["calm"].sizes], rows)
