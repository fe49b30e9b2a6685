"""What `tune` promises beside what is true: random scenes, calm ones and every preset among them.

Each scene asks for an accuracy of its own, from a centimetre to a nanometre, and runs as it is tuned for a second. Its error is
the RMS distance over the particles, worst of all steps, from SciPy's DOP853 on a right-hand side that shares no code with the
kernels (`reference`). No point of the figure may lie above the line on which error and promise are equal.

Presets hold what the right-hand side knows: `storm_flag` flies without its turbulence, collisions and pressure, in the cosine
wind of `flag`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flag_env.physics import Scene, Simulator, presets, tune
from flag_env.physics.accuracy import price_of
from flag_env.physics.effects import AirPressure, CosineWind, MastCollision, SelfCollision
from flag_env.studies import reference

SCENES = 100
"""Scenes of a full study."""

QUICK = 12
"""Scenes of a quick one: flags in air alone, which share their compiled code."""

PROMISES = (1e-2, 1e-9)
"""Largest and smallest accuracy asked for [m]."""

REPORT_LENGTH = 10.0
"""Lengths of `presets.rope` and `presets.report_flag`, whose unit is a spacing, to a metre: they are promised so much more."""

Named = tuple[str, Scene]


def scenes(quick: bool) -> list[Named]:
    """Scenes with their names: every preset calm and in wind, then random flags, every third of them calm."""
    found = _presets()
    kinds = ("damped", "damped", "damped", "undamped")
    for number in range(SCENES - len(found)):
        rng = np.random.default_rng((15, number))
        calm, kind = number % 3 == 0, kinds[number % len(kinds)]
        flag = _random_flag(rng, kind == "undamped")
        name = f"random {number}, {kind}, {'calm' if calm else 'windy'}"
        found.append((name, flag if calm else _blown(flag, rng)))
    alike = [(name, scene) for name, scene in found if name.startswith(("flag", "random")) and "undamped" not in name]
    return alike[:QUICK] if quick else found


def _presets() -> list[Named]:
    """All presets, small."""
    rng = np.random.default_rng(0)
    storm = presets.storm_flag(6, 8).without(AirPressure, SelfCollision, MastCollision).adding(CosineWind())
    calm = {
        "flag": presets.flag(6, 8),
        "sheet": presets.sheet(5, 7),
        "two_layer_flag": presets.two_layer_flag(5, 6),
        "storm_flag": storm,
    }
    found = [(f"{name}, {state}", scene if state == "calm" else _blown(scene, rng))
             for name, scene in calm.items() for state in ("calm", "windy")]  # fmt: skip
    rope = presets.rope(12, pinned="edge")
    pulled = rope.adding(CosineWind((0.0, 0.0, 300.0), (0.0, 0.0, 9.0), (0.0, 0.0, 200.0)))
    reports = [(f"report_flag, {layers} layers", presets.report_flag(layers, 4, 6)) for layers in (1, 2)]
    return [*found, ("rope, calm", rope), ("rope, windy", pulled), *reports]


def _random_flag(rng: np.random.Generator, undamped: bool) -> Scene:
    """A small flag of random size and material."""
    rows, cols = (int(count) for count in rng.integers(3, 8, 2))
    return presets.flag(
        rows, cols,
        length=rng.uniform(0.5, 2.0), height=rng.uniform(0.4, 1.5), density=rng.uniform(0.05, 0.4), taper=rng.uniform(0.1, 1.0),
        stiffness=10 ** rng.uniform(1.3, 3.0), viscosity=0.0 if undamped else 10 ** rng.uniform(-3.0, -0.5),
        drag=0.0 if undamped else rng.uniform(0.2, 3.0), pinned=("edge", "sleeve")[rng.integers(2)],
    )  # fmt: skip


def _blown(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene in a steady and a swinging wind, of its particles' weight and as much; none across a plane sheet."""
    free = np.isin(range(3), scene.lattice.axes)
    force = float(scene.lattice.masses.mean()) * free
    mean, amplitude = (tuple((force * rng.uniform(-8.0, 8.0, 3)).tolist()) for _ in range(2))
    return scene.adding(CosineWind(amplitude, tuple(rng.uniform(0.0, 12.0, 3).tolist()), mean))


def measure(name: str, scene: Scene, number: int, count: int) -> dict[str, Any]:
    """One row: what is promised to scene `number` of `count`, what is true, and how it is kept."""
    large, small = PROMISES
    unit = REPORT_LENGTH if name.startswith(("rope", "report")) else 1.0
    promised = unit * large * (small / large) ** ((7 * number % count) / max(count - 1, 1))  # spread over all kinds of scenes
    tuned = tune(scene, promised)
    simulator = Simulator(tuned, threads=1)
    start, frame, path = Simulator(scene.replace(dtype="float64")).positions[0], simulator.frame(), []
    steps = round(1.0 / simulator.timestep)
    for _ in range(steps):
        simulator.step_into(1, frame)
        path.append(frame.positions[0].copy())
    times = np.arange(1, steps + 1) * simulator.timestep
    exact = reference.path(scene, times, start, rtol=1e-12, atol=1e-14)
    errors = np.sqrt(((np.array(path) - exact) ** 2).sum(axis=-1).mean(axis=(1, 2, 3)))
    return {
        "scene": name,
        "particles": scene.lattice.size,
        "promised [m]": promised,
        "error [m]": float(errors.max()),
        "share": float(errors.max() / promised),
        "worst at [s]": float(times[errors.argmax()]),
        "integrator": type(tuned.integrator).__name__,
        "dtype": tuned.dtype,
        "steps": steps,
        "evaluations in float64": price_of(tuned) * steps,
    }


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """By kind of scene: how many, how many break their promise, and the shares of it that their errors take."""
    groups = {
        "calm": [row for row in rows if row["scene"].endswith("calm")],
        "in wind": [row for row in rows if not row["scene"].endswith("calm")],
        "all": rows,
    }
    return [
        {
            "scenes": name,
            "number": len(group),
            "promises broken": sum(row["error [m]"] > row["promised [m]"] for row in group),
            "error / promise, median": float(np.median([row["share"] for row in group])),
            "largest": max(row["share"] for row in group),
        }
        for name, group in groups.items()
        if group
    ]
