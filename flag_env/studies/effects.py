"""What each effect costs: nanoseconds per particle-step, and its share of its scene's step.

All measured steps start from the same motion, that of the whole scene, and take turns. The integrator's cost is that of a step
without any effect. A scene is then built up effect by effect, and an effect costs what it adds. Since that depends on the company
(the compiler and the processor's cache treat a step as a whole), it is built up twice, the forces from the first to the last and
from the last to the first, and the mean counts: a Shapley value (Shapley 1953) over these two orders. What corrects positions
after a step (`project`) has nothing to correct alone, and comes last both times. The table gives what was added in either order
too; the sum stands beside the whole step, measured by itself.

Start times come from fresh processes: with nothing compiled yet; with an effect more or less than has been compiled before; and
from cache.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from tqdm import tqdm

from flag_env.physics import Scene, Simulator, effects, presets
from flag_env.physics.effects import Effect
from flag_env.studies import report
from flag_env.studies.timing import fastest

_START = """
import time
begin = time.perf_counter()
from flag_env.physics import Simulator
from flag_env.studies.effects import other, scenes
imported = time.perf_counter()
scene = scenes()[{name!r}]
Simulator({scene}).step(1)
print(imported - begin, time.perf_counter() - imported)
"""

PLACES = 4
"""Simulators of each cut, the quickest of which counts: where its arrays lie in memory can make a step a fifth slower."""

SECONDS = 0.5
"""How long the whole scene moves before it is measured: by then a cloth has folded and touches [s]."""


def scenes() -> dict[str, Scene]:
    """The scenes that are taken apart, by name; every effect of the catalogue is in one of them."""
    flag = presets.flag()
    return {
        "rope": presets.rope(640),
        "sheet": presets.sheet(),
        "flag": flag,
        "flag, float32": flag.replace(dtype="float32"),
        "two_layer_flag": presets.two_layer_flag(),
        "report_flag": presets.report_flag(),
        "storm_flag": presets.storm_flag(),
        "frail flag": flag.without(effects.CosineWind).adding(effects.Gusts(), effects.StrainLimit(0.02), effects.Tearing(0.5)),
    }


def other(scene: Scene) -> Scene:
    """The scene with one effect more or less: a combination that has not been compiled before."""
    changed = scene.without(effects.AirDrag)
    return scene.adding(effects.AirDrag()) if changed == scene else changed


def _beginnings(order: list[Effect]) -> list[list[Effect]]:
    return [order[:count] for count in range(len(order) + 1)]


def measure(name: str, scene: Scene, rounds: int) -> list[dict[str, Any]]:
    """Rows for one scene: the integrator, each effect, their sum, the whole."""
    whole = Simulator(scene, threads=1)
    whole.step(max(1, round(SECONDS / whole.timestep)) if scene.lattice.dimensions > 1 else 1)
    positions, velocities = whole.positions, whole.velocities
    fixed = scene.replace(timestep=whole.timestep, allow_unstable=True)
    acts = [hasattr(run, "force") for run in whole.run.effects]
    forces = [effect for effect, force in zip(scene.effects, acts, strict=True) if force]
    corrections = [effect for effect, force in zip(scene.effects, acts, strict=True) if not force]
    orders = [[*forces, *corrections], [*reversed(forces), *corrections]]

    def cut(held: list[Effect]) -> Scene:
        return fixed.replace(effects=tuple(effect for effect in fixed.effects if effect in held))

    parts: dict[Scene | str, Scene] = {one: one for order in orders for one in map(cut, _beginnings(order))}
    parts["whole step"] = fixed
    simulators = {(part, i): Simulator(one, threads=1) for part, one in parts.items() for i in range(PLACES)}
    steps = max(1, 50_000 // scene.lattice.size)

    def prepare(simulator: Simulator) -> None:
        simulator.set_positions(positions)
        simulator.set_velocities(velocities)
        simulator.step(1)  # makes the lists that a collision goes on from

    times = fastest(
        {place: partial(simulator.step, steps) for place, simulator in simulators.items()},
        rounds,
        {place: partial(prepare, simulator) for place, simulator in simulators.items()},
    )
    best = {part: min(times[part, i] for i in range(PLACES)) for part in parts}
    per = {part: 1e9 * seconds / (steps * scene.lattice.size) for part, seconds in best.items()}
    total = per["whole step"]
    rows = [_row(name, "integrator", [per[cut([])]], total)]
    for effect in scene.effects:
        added = []
        for order in orders:
            before = order[: order.index(effect)]
            added.append(per[cut([*before, effect])] - per[cut(before)])
        rows.append(_row(name, type(effect).__name__, added, total))
    rows.append(_row(name, "sum", [sum(row["ns per particle-step"] for row in rows)], total))
    return [*rows, _row(name, "whole step", [total], total)]


def _row(scene: str, part: str, costs: list[float], whole: float) -> dict[str, Any]:
    mean = sum(costs) / len(costs)
    spread = f"{min(costs):.1f} to {max(costs):.1f}" if len(costs) > 1 else ""
    return {"scene": scene, "part": part, "ns per particle-step": mean, "in the two orders": spread, "share": mean / whole}


def agreement(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """For each scene the sum of costs over the whole step, and the cost of self-collision over that of the springs."""
    springs = {kind.__name__ for kind in effects.LinkEffect.__subclasses__()}
    found = []
    for name in dict.fromkeys(row["scene"] for row in rows):
        costs = {row["part"]: row["ns per particle-step"] for row in rows if row["scene"] == name}
        collision = costs.get("SelfCollision")
        ratio = "" if collision is None else collision / sum(cost for part, cost in costs.items() if part in springs)
        found.append({"scene": name, "sum / whole step": costs["sum"] / costs["whole step"], "SelfCollision / springs": ratio})
    return found


def start_times(name: str) -> dict[str, Any]:
    """Seconds to the end of the first step, without imports, in a fresh process each."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}

        def start(scene: str) -> list[float]:
            command = [sys.executable, "-c", _START.format(name=name, scene=scene)]
            told = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
            return [float(word) for word in told.split()]

        first, new, cached = start("scene"), start("other(scene)"), start("scene")
    return {
        "scene": name,
        "nothing compiled [s]": first[1],
        "new combination [s]": new[1],
        "from cache [s]": cached[1],
        "imports [s]": cached[0],
    }


def run(output: Path, quick: bool) -> None:
    """Measure, print the tables, write effects.json and effects.png."""
    chosen = {name: scene for name, scene in scenes().items() if not quick or name in ("rope", "flag")}
    rows: list[dict[str, Any]] = []
    for name, scene in tqdm(chosen.items(), desc="cost"):
        rows += measure(name, scene, rounds=10 if quick else 60)
    starts = [start_times(name) for name in tqdm(chosen, desc="start")]
    sums = agreement(rows)
    report.write(output, "effects", rows, _figure(rows), agreement=sums, starts=starts)
    print(report.table(sums))
    print(report.table(starts))


def _figure(rows: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    axes = figure.subplots()
    names = list(dict.fromkeys(row["scene"] for row in rows))
    parts = list(dict.fromkeys(row["part"] for row in rows if row["part"] not in ("sum", "whole step")))
    colours = dict(zip(parts, _palette(len(parts)), strict=True))
    for height, name in enumerate(names):
        left = 0.0
        for row in rows:
            if row["scene"] != name or row["part"] in ("sum", "whole step"):
                continue
            cost = max(row["ns per particle-step"], 0.0)
            axes.barh(height, cost, left=left, color=colours[row["part"]], label=row["part"], edgecolor="white", linewidth=0.5)
            left += cost
        whole = next(row for row in rows if row["scene"] == name and row["part"] == "whole step")["ns per particle-step"]
        axes.plot([whole, whole], [height - 0.45, height + 0.45], color="black", linewidth=1.5, label="whole step, measured")
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(unique.values(), unique.keys(), frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("nanoseconds per particle and step, one thread")
    axes.set_title("A scene pays for its own effects only")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _palette(count: int) -> list[Any]:
    from matplotlib import colormaps

    return [colormaps["tab20"](index % 20) for index in range(count)]
