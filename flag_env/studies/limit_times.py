"""What it costs to know a step limit: flags of 20 x 32 particles of every kind, the slowest known among them, and random ones.

Milliseconds of processor time. `python -m flag_env.studies.limit_times RESULTS/stability.json` measures them anew within a minute
or two and leaves the rest of that file as it is.
"""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from flag_env._files import machine, read_json, write_bytes
from flag_env.physics import Lattice, Scene, max_timestep, presets
from flag_env.physics.effects import AirDrag, Bending, CrossLayer, Effect, LinkEffect, Shear, Structural, Tearing
from flag_env.physics.integrators import Integrator
from flag_env.physics.limits import forget_limits
from flag_env.studies import report
from flag_env.studies.margins import METHODS

KIND = "flag of 20 x 32: limit in ms"
"""Head of the first column."""


def flags() -> dict[str, Scene]:
    """Plain flags, and those that take longest."""
    two = presets.two_layer_flag(20, 32)
    links = [effect for effect in two.effects if isinstance(effect, LinkEffect)]
    axial, even = ([replace(effect, **changed) for effect in links] for changed in ({"damping": "axial"}, {"tapered": False}))
    bending = next(effect for effect in links if isinstance(effect, Bending))
    return {
        "one layer": presets.flag(20, 32),
        "undamped": presets.flag(20, 32, viscosity=0.0),
        "overdamped": presets.flag(20, 32, viscosity=0.2),
        "two layers": two,
        "two, undamped": presets.two_layer_flag(20, 32, viscosity=0.0),
        "two, overdamped": presets.two_layer_flag(20, 32, viscosity=0.2),
        "two, viscosity x 1000": presets.two_layer_flag(20, 32, viscosity=20.0),
        "two, axial dampers": two.adding(*axial),
        "two, mass tapered alone": two.adding(*even),
        "two, edge of 0.1 % of the mass": presets.two_layer_flag(20, 32, taper=1e-3),
        "two, sleeve, overdamped": presets.two_layer_flag(20, 32, viscosity=0.2, pinned="sleeve"),
        "two, bending x 100": two.adding(bending.scaled(100.0, 1.0)),
        "two, bending x 10 000": two.adding(bending.scaled(1e4, 1.0)),
        "two, bending undamped, tears": two.adding(bending.scaled(1.0, 0.0), Tearing(0.5)),
        "two, mass tapered alone, tears": two.adding(*even, Tearing(0.5)),
        "two, bending x 10 000, overdamped, tears": presets.two_layer_flag(20, 32, viscosity=0.2).adding(
            replace(bending, stiffness=1e4 * bending.stiffness, viscosity=0.2), Tearing(0.5)
        ),
    }


def random_flag(random: np.random.Generator) -> Scene:
    """One or two layers, any masses, pins and taper; links a hundred thousand times as stiff as others; any damping or none."""
    layers, mass = int(random.integers(1, 3)), 10 ** random.uniform(-4, -1)
    pinned = str(random.choice(["edge", "sleeve", "ends", "none"]))
    lattice = Lattice(layers, 20, 32, (0.05, 0.05 * random.uniform(0.5, 2)), mass, 10 ** random.uniform(-3, 0.2), pinned)
    effects: list[Effect] = []
    ratio = 10 ** random.uniform(-3, 1.5)
    for kind in (Structural, Shear, Bending, *((CrossLayer,) if layers == 2 else ())):
        if kind is Structural or random.random() < 0.8:
            stiffness = mass * 10 ** random.uniform(2, 7) * (random.random() < 0.9)
            viscosity = ratio * 10 ** random.uniform(-1, 1) * math.sqrt(max(stiffness, 1e3 * mass) * mass)
            damping = str(random.choice(["isotropic", "axial"], p=[0.7, 0.3]))
            damped = bool(random.random() < 0.8)
            effects.append(kind(stiffness, viscosity * damped, damping, tapered=bool(random.random() < 0.5)))
    if random.random() < 0.6:
        effects.append(AirDrag(10 ** random.uniform(-2, 3)))
    if random.random() < 0.5:
        effects.append(Tearing(0.5))
    return Scene(lattice, tuple(effects))


def limit_times(rounds: int, scenes: int) -> list[dict[str, Any]]:
    """A row for each flag, for the median and the worst of so many random ones, and for a limit that is remembered."""
    rows = [_row(name, flag, rounds) for name, flag in tqdm(flags().items(), desc="limits", leave=False)]
    seeds, fewer = tqdm(range(scenes), desc="limits of random flags", leave=False), max(2, rounds // 4)
    random = [_row("", random_flag(np.random.default_rng(seed)), fewer) for seed in seeds]
    names = [type(method).__name__ for method in METHODS]
    for name, of in (("median", np.median), ("worst", np.max)):
        found = {method: float(of([row[method] for row in random])) for method in names}
        rows.append({KIND: f"{scenes} random ones, {name}", **found})
    known = presets.flag(20, 32)
    rows.append({KIND: "once more", **{type(method).__name__: _remembered(known, method) for method in METHODS}})
    return rows


def _row(name: str, flag: Scene, rounds: int) -> dict[str, Any]:
    times = {}
    for method in METHODS:
        scene = flag.replace(integrator=method)
        times[type(method).__name__] = min(_milliseconds(scene) for _ in range(rounds))
    return {KIND: name, **times}


def _milliseconds(scene: Scene) -> float:
    forget_limits()
    return _again(scene)


def _remembered(flag: Scene, method: Integrator) -> float:
    scene = flag.replace(integrator=method)
    max_timestep(scene)
    return _again(scene)


def _again(scene: Scene) -> float:
    start = time.process_time()
    max_timestep(scene)
    return 1e3 * (time.process_time() - start)


def refresh(path: Path) -> None:
    """Measure anew what the file of a study of stability says of them."""
    result = read_json(path)
    result["limit_times"], result["limit_times_machine"] = limit_times(20, 200), machine()
    write_bytes(path, (json.dumps(result, indent=1) + "\n").encode())
    print(report.table(result["limit_times"]))


if __name__ == "__main__":
    refresh(Path(sys.argv[1]))
