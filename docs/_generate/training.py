"""Tables of what agents and baselines reach, from `training/results`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from docs._generate.markdown import percent, table

BASELINES = {"zero": "zero", "random": "random", "lookup": "look-up", "p_control": "P-control"}
RESULTS = Path(__file__).resolve().parents[2] / "training" / "results"


def read(name: str) -> Any:
    """A results file."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def pages() -> dict[str, str]:
    """Tables of the results page."""
    return {
        "results.md": results(),
        "ppo_wind.md": benchmark(read("wind_breeze_ppo")),
        "ppo_mast.md": benchmark(read("mast_breeze_ppo")),
        "accuracy_cost.md": accuracy_cost(),
        "accuracy_speed.md": table(
            ["accuracy", "steps per second, 16 flags"],
            [[name, f"{round(rate, -2):_.0f}".replace("_", " ")] for name, rate in read("accuracy_cost")["speed"].items()],
            right=True,
        ),
        "vector_speed.md": vector_speed(),
        "learning_machines.md": machines(),
    }


def results() -> str:
    """Success at 5 % of every baseline and of PPO on each control and level."""
    shown = []
    for path in sorted(RESULTS.glob("baselines_*.json"), reverse=True):
        found, task = read(path.stem)["policies"], path.stem.removeprefix("baselines_")
        agent = RESULTS / f"{task}_ppo.json"
        learnt = read(agent.stem) if agent.exists() else None
        cells = [percent(found[name]["success_5"]) if name in found else "" for name in BASELINES]
        seconds = f"{max(row['seconds'] for row in learnt['seeds']):.0f} s" if learnt else ""
        shown.append([task.replace("_", ", "), *cells, f"**{percent(learnt['mean']['success_5'])}**" if learnt else "", seconds])
    return table(["control, level", *BASELINES.values(), "PPO, 3 seeds", "training"], shown, right=True)


def policies(result: dict[str, Any]) -> list[list[str]]:
    """A row for each seed, their mean and each baseline: name, success at 5 and 3 %, distance."""
    name = result["algo"].upper()
    named = [(f"{name}, seed {row['seed']}", row) for row in result["seeds"]]
    named += [(f"**{name}, mean**", result["mean"]), *result["baselines"].items()]
    return [[who, percent(row["success_5"]), percent(row["success_3"]), percent(row["median_distance"])] for who, row in named]


def benchmark(result: dict[str, Any]) -> str:
    """Success of the seeds of one training, and of what learns nothing."""
    seconds = [(row["seconds"], row["seconds_to_95"]) for row in result["seeds"]]
    times = [[f"{whole:.0f} s", f"{soon:.0f} s" if soon else "never"] for whole, soon in seconds]
    times += [["", ""]] * (1 + len(result["baselines"]))
    rows = [[*row, *time] for row, time in zip(policies(result), times, strict=True)]
    heads = ["policy", "success at 5 %", "success at 3 %", "median distance", "training", "validation at 95 % after"]
    return table(heads, rows, right=True)


def accuracy_cost() -> str:
    """Success by the accuracy that an agent was trained and evaluated at: mean, least and most of the seeds."""
    rows = read("accuracy_cost")["rows"]
    pairs = dict.fromkeys((row["trained on"], row["evaluated on"]) for row in rows)
    shown = []
    for trained, evaluated in pairs:
        same = [row for row in rows if (row["trained on"], row["evaluated on"]) == (trained, evaluated)]
        shown.append([trained, evaluated, _range(same, "success_5"), _range(same, "success_3"), _median(same)])
    return table(["trained on", "evaluated on", "success at 5 %", "success at 3 %", "median distance"], shown, right=True)


def _range(rows: list[dict[str, Any]], key: str) -> str:
    values = [row[key] for row in rows]
    spread = f" ({percent(min(values))} to {percent(max(values))})" if len(values) > 1 else ""
    return percent(float(np.mean(values))) + spread


def _median(rows: list[dict[str, Any]]) -> str:
    return percent(float(np.mean([row["median_distance"] for row in rows])))


def vector_speed() -> str:
    """Microseconds a step on the native vector environment and on `DummyVecEnv`."""
    heads = ["µs a step of one flag", "`FlagSB3VecEnv`", "`DummyVecEnv`", "times as fast", "in the quickest turns"]
    rows = [
        [
            row[""], f"{row['FlagSB3VecEnv, mean']:.1f}", f"{row['DummyVecEnv, mean']:.1f}", f"{row['ratio, mean']:.2f}",
            f"{row['ratio, quickest']:.2f}",
        ]
        for row in read("vector_speed")["rows"]
    ]  # fmt: skip
    return table(heads, rows, right=True)


def machines() -> str:
    """Where each file was measured."""
    rows = []
    for path in sorted(RESULTS.glob("*.json")):
        result = read(path.stem)
        if not {"machine", "versions"} & set(result):
            continue
        where = result["machine"]["processor"] if "machine" in result else result["versions"]["machine"]
        date = result.get("date") or result.get("machine", {}).get("date", "")
        rows.append([f"`training/results/{path.name}`", where, date])
    return table(["file", "machine", "date"], rows)
