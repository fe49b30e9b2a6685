"""What accuracy costs in time.

Time: error against a reference solution and wall time of the same run, for every integrator, several timesteps and both dtypes,
on the environments' flag, also on the coarser lattice of "fast", and three other scenes (`work_precision`, `reference`,
`energy_budget`), with the accuracy presets of `tune`. Space: one flag on
ever finer lattices (`refinement`). Horizon: how fast errors grow, and, where they do, what a flag does on average beyond
(`horizon`).

Promises: what `tune` promises beside what is true (`promises`), with a table, a figure and a file of its own.

Finished parts are kept beside the results; a run that was stopped goes on after them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from flag_env.physics import Scene, tune
from flag_env.physics.integrators import LFAB, Implicit, Leapfrog, Strang
from flag_env.studies import accuracy_figure, horizon, promises, promises_figure, refinement, report, work_precision
from flag_env.studies.accuracy_scenes import ENVIRONMENT, METHODS, scenes, stepped
from flag_env.studies.parts import Parts

STANDARD = "LFAB, half its limit"
"""The run whose averages the others are held against."""

LATEST = 90.0
"""Horizon beyond which a scene's paths can be compared for as long as anyone will look [s]."""

COARSE = ("leapfrog (report)", "leapfrog (half kick)", "LFAB", "Strang", "RK4", "implicit")
"""Methods that are measured on the coarser lattice of "fast" too."""

QUICK_LEFT_OUT = ("explicit Euler", "leapfrog (half kick)", "Strang")
"""Methods that a quick run does not measure."""

QUICK_SCENES = ("Flag-v0", "gusty")
"""Scenes that a quick run measures: the reference solutions of the others take half a minute."""

QUICK_SINGLE = ("LFAB", "RK4")
"""Methods that a quick run measures in float32 too."""

_NAMED = ("scene", "lattice", "method", "dtype", "share of limit")
"""What tells rows apart."""

_SOURCES = ("accuracy", "accuracy_scenes", "energy_budget", "horizon", "promises", "reference", "refinement", "work_precision")


def run(output: Path, quick: bool) -> None:
    """Measure, print the tables, write accuracy.json, accuracy.png, promises.json and promises.png."""
    here = Path(__file__).parent
    sources = tuple(here / f"{name}.py" for name in _SOURCES)
    parts = Parts(output / "accuracy.parts.json", sources, quick=quick)
    chosen = {name: scene for name, scene in scenes().items() if name in QUICK_SCENES or not quick}
    sizes = refinement.SIZES[:3] if quick else refinement.SIZES
    with tqdm(desc="accuracy", unit="run", total=0) as bar:
        kept = _promises(parts, promises.scenes(quick), bar)
        rows = _work(parts, chosen, quick, bar)
        found = _all(parts, bar, {f"lattice {size}": partial(refinement.poses, *size) for size in sizes})
        space = refinement.table(list(found.values()), sizes)
        seconds = 3.0 if quick else 60.0
        grown = _all(parts, bar, {f"growth {name}": partial(horizon.growth, scene, seconds) for name, scene in chosen.items()})
        growths = dict(zip(chosen, grown.values(), strict=True))
        averages = _averages(parts, chosen, growths, quick, bar)
    by_scene = {name: [row for row in rows if row["scene"] == name] for name in chosen}
    gain = work_precision.gain(by_scene["gusty"])
    presets = {name: work_precision.summary(own) for name, own in by_scene.items()}
    figure = accuracy_figure.draw(rows, space, growths, averages)
    brief = [{key: value for key, value in row.items() if not isinstance(value, list)} for row in rows]
    errors = [{key: row[key] for key in (*_NAMED, "RMS errors [m]", "worst errors [m]")} for row in rows]
    details = {"space": space, "growth": growths, "averages": averages, "presets": presets, "gain": gain}
    report.write(output, "accuracy", brief, figure, times=work_precision.TIMES, errors=errors, **details)
    print(report.table(space))
    if averages:
        print(report.table(averages))
    for name, grown in growths.items():
        until = f"1e-9 m becomes 1 mm after {grown['horizon']:.3g} s" if grown["horizon"] else "errors die out"
        print(f"{name}: errors grow at {grown['rate']:.2f} /s; {until}")
    for name, own in presets.items():
        print(f"\npresets on {name}\n{report.table(own)}")
    print(f"\ngusty: at equal wall time the report's scheme is {gain:.0f} times less accurate than LFAB at half its limit")
    report.write(output, "promises", kept, promises_figure.draw(kept), summary=promises.summary(kept))
    print(report.table(promises.summary(kept)))
    parts.close()


def _all(parts: Parts, bar: Any, jobs: Mapping[str, Callable[[], Any]]) -> dict[str, Any]:
    """Results of the jobs by name, each counted by the bar."""
    bar.total += len(jobs)
    bar.refresh()
    results = {}
    for name, job in jobs.items():
        bar.set_postfix_str(name)
        results[name] = parts.get(name, job)
        bar.update()
    return results


def _promises(parts: Parts, named: list[promises.Named], bar: Any) -> list[dict[str, Any]]:
    """Rows of promised and true errors."""
    count = len(named)
    jobs = {f"promise to {name}": partial(promises.measure, name, scene, i, count) for i, (name, scene) in enumerate(named)}
    return list(_all(parts, bar, jobs).values())


def _work(parts: Parts, chosen: dict[str, Scene], quick: bool, bar: Any) -> list[dict[str, Any]]:
    """Rows of work and precision of all scenes; each says whether it is on its scene's front."""
    shares = work_precision.SHARES[:3] if quick else work_precision.SHARES
    rounds, window = (2, 0.04) if quick else (5, work_precision.TIMES[0])
    coarse = {name: tune(scene, "fast").replace(dtype="float64") for name, scene in chosen.items()}
    paths = {f"path of {name}": partial(work_precision.truth, scene) for name, scene in chosen.items()}
    halved = (name for name, scene in coarse.items() if scene.lattice != chosen[name].lattice)
    paths |= {f"path of {name}, fast": partial(work_precision.truth, coarse[name]) for name in halved}
    truths = _all(parts, bar, paths)
    jobs: dict[str, Callable[[], Any]] = {}
    for name, scene in chosen.items():
        cases = work_precision.presets(scene)
        for dtype in work_precision.DTYPES:
            methods = tuple(METHODS)
            if quick:
                methods = QUICK_SINGLE if dtype == "float32" else tuple(name for name in METHODS if name not in QUICK_LEFT_OUT)
            cases += work_precision.grid(scene, dtype, shares, methods)
            if name == ENVIRONMENT:
                cases += work_precision.grid(coarse[name], dtype, shares, [name for name in methods if name in COARSE])
        own = truths[f"path of {name}"]
        expected = {coarse[name].lattice: np.array(truths.get(f"path of {name}, fast", own)), scene.lattice: np.array(own)}
        # all of a scene in one job: their times stand in one ratio however busy the machine is
        jobs[f"work {name}"] = partial(work_precision.measure, name, cases, scene.lattice, expected, rounds, window, bar.refresh)
    rows: list[dict[str, Any]] = []
    for own in _all(parts, bar, jobs).values():
        best = work_precision.front(own)
        rows += [row | {"on the front": row in best} for row in own]
    return rows


def _runs(scene: Scene) -> dict[str, Scene]:
    """What is compared past the horizon."""
    single = scene.replace(dtype="float32")
    unit = horizon.FRAME
    return {
        STANDARD: stepped(scene.replace(integrator=LFAB()), 0.5, unit),
        "LFAB, 0.95, float32": stepped(single.replace(integrator=LFAB()), 0.95, unit),
        "leapfrog (report), 0.95": stepped(scene.replace(integrator=Leapfrog()), 0.95, unit),
        "Strang, 0.95, float32": stepped(single.replace(integrator=Strang()), 0.95, unit),
        "implicit, 8 explicit limits": stepped(scene.replace(integrator=Implicit()), 0.5, unit),
    }


def _averages(parts: Parts, chosen: dict[str, Scene], growths: dict[str, Any], quick: bool, bar: Any) -> list[dict[str, Any]]:
    """Rows of the comparison past the horizon, for scenes that have one before `LATEST`."""
    rows: list[dict[str, Any]] = []
    for name, scene in chosen.items():
        horizon_of = growths[name]["horizon"]
        if horizon_of is None or horizon_of > LATEST:
            continue
        settle, seconds = (1.0, 2.0) if quick else (math.ceil(horizon_of), 12.0)
        runs = _runs(scene)
        names = list(runs)[:2] if quick else list(runs)
        jobs = {f"averages of {name}, {run}": partial(horizon.watch, runs[run], settle, seconds) for run in names}
        found = dict(zip(names, _all(parts, bar, jobs).values(), strict=True))
        window = {"from [s]": settle, "to [s]": settle + seconds}
        rows += [{"scene": name, **window, **row} for row in horizon.compare(found, STANDARD)]
    return rows
