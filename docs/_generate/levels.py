"""Tables of the ladder of levels: what each asks for, and how hard it was found to be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docs._generate.markdown import code, percent, table
from flag_env._files import read_json
from flag_env.envs.config import FlagConfig
from flag_env.envs.flag import FlagEnv
from flag_env.tasks import LEVELS, rungs

RESULTS = Path(__file__).resolve().parents[2] / "training" / "results" / "difficulty.json"

POLICIES = {
    "zero": "no action",
    "random": "random",
    "lookup": "nearest witness",
    "lookup_20": "best of 20 nearest",
    "p_control": "mast controller",
    "ppo": "PPO",
    "planner_blind": "planner, blind",
    "planner": "planner",
    "witness": "witness",
}
"""Columns of the table of difficulty."""


def pages() -> dict[str, str]:
    """Both tables."""
    return {"levels.md": levels(), "difficulty.md": difficulty(), "difficulty_distance.md": distances()}


def levels() -> str:
    """Every rung: what is hidden, asked for, seen and paid."""
    rows = []
    for control, name in rungs():
        level, seen = LEVELS[name], FlagEnv(control, name).observation_space.shape[0]
        goal = "follow" if level.goal.moving else "hold" if level.goal.steps > 1 else "meet at the end"
        hidden = " x ".join(f"{most:g}" for most in level.hidden_wind) if any(level.hidden_wind) else "none"
        size = FlagConfig(control, name).control_type.size
        sizes = " / ".join(str(count) for count in level.sizes.values())
        rows.append([code(control), code(name), goal, hidden, size, f"{code(level.view)}, {seen}", code(level.reward), sizes])
    heads = ["control", "level", "goal", "hidden wind [m/s²]", "actions", "view, entries", "reward", "targets a split"]
    return table(heads, rows)


def _measured() -> dict[str, Any]:
    return dict(read_json(RESULTS)["rungs"])


def difficulty() -> str:
    """Success of every policy on every rung; where the target moves, also the share of the steps that count."""
    rows = []
    for rung, row in _measured().items():
        rows.append([code(rung), *(_score(row.get(name)) for name in POLICIES)])
    return table(["rung", *POLICIES.values()], rows)


def distances() -> str:
    """How near test targets are to training targets."""
    shown = ("least", "median", "within_5")
    rows = [
        [code(rung), *(percent(row["nearest"][name]) for name in shown)] for rung, row in _measured().items() if "nearest" in row
    ]
    return table(["rung", "least", "median", "test targets within 5 % of one"], rows)


def _score(result: dict[str, Any] | None) -> str:
    if result is None:
        return "-"
    steps = f" ({percent(result['steps_5'], 0)})" if "steps_5" in result else ""
    return f"{percent(result['success_5'], 0)}{steps}"
