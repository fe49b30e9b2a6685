"""Speed of the simulator alone, beside a plain Numba loop and MuJoCo's cloth."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from flag_env.control import CONTROL_STEP
from flag_env.physics import Scene, Simulator, effects, integrators, max_timestep, tune
from flag_env.physics.runtime import Threads
from flag_env.studies import mujoco_flag
from flag_env.studies.plain import PlainFlag, springs
from flag_env.studies.roofline import arithmetic
from flag_env.studies.speed_rows import Row
from flag_env.studies.timing import fastest

SIZES = ((10, 16), (20, 32), (40, 64))
BARS = {(20, 32, "float32"): (5.0, 10.0), (20, 32, "float64"): (2.5, 3.5), (10, 16, "float32"): (2.5, 5.0)}
GROWING = ((5, 8), (10, 16), (20, 32), (40, 64), (80, 128), (160, 256))
COPIES = 64


def plain_of(scene: Scene, timestep: float) -> PlainFlag:
    """The plain Numba flag of the same scene."""
    links = [effect for effect in scene.effects if isinstance(effect, effects.LinkEffect)]
    stiffness, viscosity = (tuple(getattr(link, name) for link in links) for name in ("stiffness", "viscosity"))
    lattice = scene.lattice
    return PlainFlag(
        lattice.rows, lattice.cols, lattice.spacings[:2], lattice.masses, stiffness, viscosity, timestep, scene.dtype
    )  # fmt: skip


def one_flag(quick: bool) -> list[Row]:
    """Particle-steps per second of one flag, ours over plain."""
    rows = []
    for dtype in ("float32", "float64"):
        for up, along in SIZES:
            scene = springs(up, along, dtype)
            simulator = Simulator(scene, threads=1)
            plain = plain_of(scene, simulator.timestep)
            steps = max(1, 300_000 // scene.lattice.size)
            jobs = {"ours": _stepping(simulator, steps), "plain": _stepping(plain, steps)}
            times = fastest(jobs, 10 if quick else 20)
            speed = {name: steps * scene.lattice.size / 1e6 / time for name, time in times.items()}
            bar, aim = BARS.get((up, along, dtype), (0.0, 0.0))
            note = f"{speed['ours']:.1f} against {speed['plain']:.1f} M particle-steps/s"
            rows.append(
                Row(f"one {up} x {along} flag, {dtype}", "x plain Numba", times["plain"] / times["ours"], bar, aim, note=note)
            )
    return rows


def _stepping(flag: Any, steps: int) -> Any:
    return lambda: flag.step(steps)


def _both() -> None:
    arithmetic(0)
    arithmetic(1)


def many_flags(quick: bool) -> list[Row]:
    """64 flags of 10 x 16 on one and on two threads, and what two threads do for a loop of additions and multiplications."""
    scene = springs(10, 16, "float32")
    one, two = (Simulator(scene, COPIES, threads=threads) for threads in (1, 2))
    plain = plain_of(scene, one.timestep)
    steps = 100
    pool = Threads(2)
    jobs = {
        "one": _stepping(one, steps), "two": _stepping(two, steps), "plain": _stepping(plain, steps),
        "arithmetic, one": _both, "arithmetic, two": lambda: pool.run(arithmetic),
    }  # fmt: skip
    times = fastest(jobs, 15 if quick else 60)
    gain, ceiling = times["one"] / times["two"], times["arithmetic, one"] / times["arithmetic, two"]
    speed = COPIES * steps * scene.lattice.size / 1e6 / times["one"]
    return [
        Row("64 flags, 10 x 16, float32, 1 thread", "x plain Numba", COPIES * times["plain"] / times["one"], 5.0, 10.0,
            note=f"{speed:.1f} M particle-steps/s"),
        Row("the same, 2 threads", "x 1 thread", gain, 1.85, 1.95,
            note=f"a loop of arithmetic in registers: {ceiling:.2f} x; {100 * gain / ceiling:.0f} % of that"),
    ]  # fmt: skip


def simulated_seconds(quick: bool) -> list[Row]:
    """Simulated seconds per second, 20 x 32: balanced accuracy, against the plain loop and MuJoCo at their largest steps."""
    base = springs(20, 32, "float64")
    balanced = tune(springs(20, 32, "float32"), "balanced", multiple_of=CONTROL_STEP)
    simulator = Simulator(balanced, threads=1)
    largest = max_timestep(base.replace(integrator=integrators.Leapfrog()))
    plain = plain_of(base, largest)
    jobs = {"ours": _stepping(simulator, 500), "plain": _stepping(plain, 500)}
    times = fastest(jobs, 10 if quick else 20)
    ours, theirs = 500 * simulator.timestep / times["ours"], 500 * largest / times["plain"]
    rows = [
        Row(
            "simulated s/s, 20 x 32, balanced",
            "x plain Numba",
            ours / theirs,
            4.0,
            10.0,
            note=f"{ours:.1f} against {theirs:.2f} s/s",
        )
    ]
    cloth = mujoco_flag.seconds_per_second(base, 0.05 if quick else 0.2)
    if cloth is None:
        rows.append(Row("the same against MuJoCo flex", "s/s", ours, note="mujoco is not installed"))
    else:
        note = f"{cloth.speed:.3g} s/s at a step of {1e3 * cloth.timestep:g} ms"
        rows.append(Row("the same against MuJoCo flex", "x MuJoCo", ours / cloth.speed, 20.0, 50.0, note=note))
    return rows


def growing(quick: bool) -> list[Row]:
    """The most that a particle-step costs on a larger lattice, over what it costs on any smaller one."""
    jobs, work = {}, {}
    for up, along in GROWING:
        scene = springs(up, along, "float32").replace(timestep=1e-6)
        steps = max(1, 300_000 // scene.lattice.size)
        jobs[up, along], work[up, along] = _stepping(Simulator(scene, threads=1), steps), steps * scene.lattice.size
    times = fastest(jobs, 30 if quick else 40)
    cost = {size: 1e9 * times[size] / work[size] for size in jobs}
    sizes = np.log([up * along for up, along in cost])
    slope = float(np.polyfit(sizes, np.log(list(cost.values())), 1)[0])
    worst = max(cost[large] / cost[small] for small, large in itertools.combinations(GROWING, 2))
    note = "ns a particle-step: " + ", ".join(f"{up}x{along} {ns:.1f}" for (up, along), ns in cost.items())
    note += f"; cost ~ particles^{1 + slope:.2f}"
    return [Row("growth 5 x 8 to 160 x 256, worst pair", "x linear", worst, 1.3, 1.1, less=True, note=note)]
