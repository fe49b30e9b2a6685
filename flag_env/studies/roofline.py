"""What bounds the kernel: the processor's arithmetic and memory, measured, beside what the 20 x 32 flag's step asks of them.

Counts are those of the source: a damped link takes 27 additions, subtractions and multiplications, one square root and one
division, and 6 more where its force is summed; a particle's update 6. Bytes are those that the loops load and store, all of which
hit the first and second level of cache: for a link 12 numbers of its ends, 3 of which it has from the other family of its pass,
a weight, its force stored, and half of two families' look at the sums. The machine code's vectors are read off its assembly.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
from matplotlib.axes import Axes

from flag_env.physics import Simulator
from flag_env.physics.compiling import cached, kernel, make_run
from flag_env.studies.plain import springs
from flag_env.studies.timing import fastest

LINK_FLOPS, LINK_BYTES = 33, (12 - 3 + 1 + 3 + 3 * 3) * 4
UPDATE_FLOPS, UPDATE_BYTES = 12, 3 * 10 * 4
_LENGTH, _REPEATS, _CHAIN_FLOPS = 1024, 8000, 38


@kernel
def _triad(a: Any, b: Any, c: Any, s: Any, n: int) -> None:
    for t in range(n):
        a[t] = b[t] + s * c[t]


@kernel
def _chain(a: Any, s: Any, n: int) -> None:
    for t in range(n):
        p, q, r, y = a[t], a[t] + s, a[t] - s, a[t] * s  # four chains, so that none waits for another
        p, q, r, y = p * s + s, q * s + s, r * s + s, y * s + s
        p, q, r, y = p * s + s, q * s + s, r * s + s, y * s + s
        p, q, r, y = p * s + s, q * s + s, r * s + s, y * s + s
        p, q, r, y = p * s + s, q * s + s, r * s + s, y * s + s
        a[t] = (p + q) + (r + y)


@kernel
def _roots(a: Any, s: Any, n: int) -> None:
    for t in range(n):
        a[t] = s / np.sqrt(a[t] + s)


def _repeat(a: Any, b: Any, c: Any, s: Any, kind: int, repeats: int) -> None:
    for _ in range(repeats):
        if kind == 0:
            _triad(a, b, c, s, a.shape[0])
        elif kind == 1:
            _chain(a, s, a.shape[0])
        else:
            _roots(a, s, a.shape[0])


@cache
def _loops() -> Callable[..., None]:
    return cached(_repeat, None)


def arithmetic(thread: int) -> None:
    """Some milliseconds of additions and multiplications in registers, in memory of its own: what a thread can do."""
    del thread
    a, b, c = np.ones((3, _LENGTH), np.float32)
    _loops()(a, b, c, np.float32(0.5), 1, _REPEATS)


def roofline(quick: bool) -> dict[str, dict[str, Any]]:
    """Bounds and the kernel's own figures, float32, one thread."""
    repeat = _loops()
    a, b, c = np.ones((3, _LENGTH), np.float32)
    half = np.float32(0.5)
    scene = springs(20, 32, "float32")
    simulator = Simulator(scene, threads=1)
    jobs = {
        "triad": lambda: repeat(a, b, c, half, 0, _REPEATS),
        "chain": lambda: repeat(a, b, c, half, 1, _REPEATS // 4),
        "roots": lambda: repeat(a, b, c, half, 2, _REPEATS // 4),
        "flag": lambda: simulator.step(400),
    }
    times = fastest(jobs, 4 if quick else 100)
    size = scene.lattice.size
    weights = [bound.weight for bound in simulator.run.effects if hasattr(bound, "offset")]
    links = sum(int(np.count_nonzero(weight)) for weight in weights)
    seconds = times["flag"] / 400
    names = ("GFLOP/s", "GB/s", "1e9 roots and divisions/s")
    done = (_CHAIN_FLOPS * _LENGTH * (_REPEATS // 4), 12 * _LENGTH * _REPEATS, _LENGTH * (_REPEATS // 4))
    machine = [1e-9 * work / times[job] for work, job in zip(done, ("chain", "triad", "roots"), strict=True)]
    asked = (links * LINK_FLOPS + size * UPDATE_FLOPS, links * LINK_BYTES + size * UPDATE_BYTES, links)
    flag = [1e-9 * work / seconds for work in asked]
    share = [ours / peak for ours, peak in zip(flag, machine, strict=True)]
    rows = {"machine, in cache": machine, "flag": flag, "share of the machine's": share}
    return {row: dict(zip(names, values, strict=True)) for row, values in rows.items()} | {"instructions": vectors(simulator)}


def draw(axes: Axes, bound: dict[str, dict[str, Any]]) -> None:
    """The flag below what memory, arithmetic, and roots with divisions allow, over arithmetic operations a byte."""
    machine, flag = bound["machine, in cache"], bound["flag"]
    here, links = flag["GFLOP/s"] / flag["GB/s"], flag["1e9 roots and divisions/s"] / flag["GFLOP/s"]
    intensity = np.geomspace(0.03, 3.0, 100)
    axes.loglog(intensity, intensity * machine["GB/s"], color="#4c78a8", label="loads and stores, in cache")
    axes.axhline(machine["GFLOP/s"], color="#e0a030", label="additions and multiplications")
    axes.axhline(
        machine["1e9 roots and divisions/s"] / links, color="#9aa3ad", ls="--", label="roots and divisions, at the flag's share"
    )
    axes.plot(here, flag["GFLOP/s"], "o", color="#2e8b57", label="the 20 x 32 flag's step")
    axes.set_ylim(2.0, 3.0 * machine["GFLOP/s"])
    axes.set_xlabel("operations a byte moved to or from the first cache")
    axes.set_ylabel("GFLOP/s, float32, one thread")
    axes.legend(fontsize=7, frameon=False, loc="lower right")
    axes.spines[["top", "right"]].set_visible(False)


def vectors(simulator: Simulator) -> dict[str, int]:
    """Floating-point instructions in a scene's machine code, compiled here and now, by the width of their registers."""
    seen: list[tuple[Any, ...]] = []

    def look(*arguments: Any) -> int:
        seen.append(arguments)
        return simulator.copies

    simulator.run.entry = look
    simulator.step(1)
    simulator.run.entry = None
    run = numba.njit(error_model="numpy", nogil=True, _nrt=False)(make_run())
    run.compile(tuple(run.typeof_pyval(argument) for argument in seen[0]))
    code = run.inspect_asm(run.signatures[0])
    lines = re.findall(r"^\tv(?:add|sub|mul|div|sqrt)[ps][sd]\t.*$", code, re.MULTILINE)
    scalar = sum(re.match(r"\tv\w+s[sd]\t", line) is not None for line in lines)
    wide, half = (sum(register in line for line in lines) for register in ("%zmm", "%ymm"))
    return {"512 bit": wide, "256 bit": half, "128 bit": len(lines) - wide - half - scalar, "scalar": scalar}
