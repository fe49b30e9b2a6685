"""How fast the simulator is, as ratios to a plain Numba flag measured in the same run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from tqdm import tqdm

from flag_env.physics import Simulator, effects, presets
from flag_env.studies import report
from flag_env.studies.plain import PlainFlag
from flag_env.studies.timing import fastest

SIZES = ((10, 16), (20, 32), (40, 64))
DTYPES = ("float32", "float64")


def measure(rows: int, cols: int, dtype: str, rounds: int) -> dict[str, Any]:
    """Particle-steps per second of one flag with gravity and the three kinds of springs, ours and plain, on one thread."""
    scene = presets.flag(rows, cols, dtype=dtype).without(effects.AirDrag, effects.CosineWind)
    simulator = Simulator(scene)
    links = [effect for effect in scene.effects if isinstance(effect, effects.LinkEffect)]
    stiffness, viscosity = (tuple(getattr(link, name) for link in links) for name in ("stiffness", "viscosity"))
    lattice = scene.lattice
    plain = PlainFlag(
        rows, cols, lattice.steps[:2], lattice.masses, stiffness, viscosity, simulator.timestep, dtype
    )  # fmt: skip
    steps = max(1, 1_000_000 // lattice.size)
    times = fastest({"ours": lambda: simulator.step(steps), "plain": lambda: plain.step(steps)}, rounds)
    work = steps * lattice.size / 1e6
    return {
        "lattice": f"{rows}x{cols}",
        "dtype": dtype,
        "M particle-steps/s": work / times["ours"],
        "plain Numba": work / times["plain"],
        "ratio": times["plain"] / times["ours"],
    }


def run(output: Path, quick: bool) -> None:
    """Measure, print the table, write speed.json and speed.png."""
    cases = [(rows, cols, dtype) for dtype in DTYPES for rows, cols in SIZES]
    rows = [measure(*case, rounds=3 if quick else 15) for case in tqdm(cases, desc="speed")]
    report.write(output, "speed", rows, _figure(rows))


def _figure(rows: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    names = [f"{row['lattice']}\n{row['dtype']}" for row in rows]
    places = range(len(rows))
    axes.bar(
        [place - 0.2 for place in places], [row["M particle-steps/s"] for row in rows], 0.4, label="flag_env", color="#c8372d"
    )
    axes.bar(
        [place + 0.2 for place in places], [row["plain Numba"] for row in rows], 0.4, label="plain Numba loop", color="#9aa3ad"
    )
    for place, row in zip(places, rows, strict=True):
        axes.annotate(f"{row['ratio']:.1f} x", (place - 0.2, row["M particle-steps/s"]), ha="center", va="bottom", fontsize=9)
    axes.set_xticks(places, names)
    axes.set_ylabel("million particle-steps per second")
    axes.set_title("One flag, gravity and springs, one thread")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return figure
