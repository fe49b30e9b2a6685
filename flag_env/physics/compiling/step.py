"""The one place that turns a scene's effects into compiled code of exactly those effects.

A scene's effects reach the compiler as a tuple of *effect data*, each a NamedTuple type of its own. The functions below look
at those types while they compile and emit one direct call for each: an absent effect leaves no instruction, no argument and no
test behind. What effect data may offer, as static attributes of its type:

`force(data, copy, x, v, f, effect_work, lag)`
    adds its forces [N] at `lag` seconds after the start of the step to `f`;
`project(data, copy, x, v, effect_work, inverse_mass, seconds)`
    after the step, moves particles to where they may be (a collision, a limit of strain);
`advance(data, copy, seconds)`
    then moves its own state (the phase of a wind) on by one step.

In plain Python, `reseed(self, copy, seed)` of an effect with random numbers lets a copy's start anew from a seed.

What an integrator's data has: `seconds`, its timestep; `rows()`, how many rows of history and of work it needs; and

`step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass)`
    takes one step;
`velocity(...)`, the same arguments
    leaves the velocities at the instant of the positions in `f`;
`start(...)`, if it has one
    makes `v` and `history` ready for a first step from velocities at the instant of the positions.

Arrays: `x, v, f` (coordinates, particles); `effect_work` (6, 2 particles), which holds anything; `inverse_mass`
(particles,), zero where pinned; `history` (rows, coordinates, particles), kept for each copy and part of its state;
`integrator_work` (rows, 3, particles), not kept.

Called from plain Python (`NUMBA_DISABLE_JIT=1`) the same functions are ordinary loops: the tests' oracle.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flag_env.physics.compiling.decorators import cached, inlined, jit, kernel

CHECK_EVERY = 50
"""Steps between two checks for non-finite numbers."""


def forces(effects: Any, copy: int, x: Any, v: Any, f: Any, effect_work: Any, lag: float) -> None:
    """Overwrite `f` with the sum of all effects' forces [N]."""
    f[:] = 0
    for data in effects:
        if hasattr(data, "force"):
            data.force(data, copy, x, v, f, effect_work, lag)


def advance(effects: Any, copy: int, seconds: float) -> None:
    """Move the effects' own state on by one step."""
    for data in effects:
        if hasattr(data, "advance"):
            data.advance(data, copy, seconds)


def project(effects: Any, copy: int, x: Any, v: Any, effect_work: Any, inverse_mass: Any, seconds: float) -> None:
    """Let the effects correct positions and velocities after a step."""
    for data in effects:
        if hasattr(data, "project"):
            data.project(data, copy, x, v, effect_work, inverse_mass, seconds)


def _in_turn(hook: str, effects: Any, arguments: str, *first: str) -> Any:
    """Function of `effects` and the arguments: lines of code `first`, then a direct call of each effect's hook, if it has one.

    Written out, not nested: the compiler would optimise and emit an inner call anew for each call around it.
    """
    kinds = [data.instance_class for data in effects.types]
    names = {f"hook_{i}": getattr(kind, hook) for i, kind in enumerate(kinds) if hasattr(kind, hook)}
    calls = [f"{name}(effects[{name.removeprefix('hook_')}], {arguments})" for name in names]
    names["clear"] = _clear
    exec("\n    ".join([f"def run(effects, {arguments}):", *first, *calls, "return"]), names)
    return names["run"]


@inlined(forces)
def _compile_forces(effects: Any, copy: int, x: Any, v: Any, f: Any, effect_work: Any, lag: float) -> Any:
    clear = "for d in range(f.shape[0]): clear(f[d], f.shape[1])"
    return _in_turn("force", effects, "copy, x, v, f, effect_work, lag", clear)


@inlined(project)
def _compile_project(effects: Any, copy: int, x: Any, v: Any, effect_work: Any, inverse_mass: Any, seconds: float) -> Any:
    return _in_turn("project", effects, "copy, x, v, effect_work, inverse_mass, seconds")


@inlined(advance)
def _compile_advance(effects: Any, copy: int, seconds: float) -> Any:
    return _in_turn("advance", effects, "copy, seconds")


def _step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
    method.step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass)


@inlined(_step)
def _compile_step(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
    return method.instance_class.step.py_func


def _start(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
    if hasattr(method, "start"):
        method.start(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass)


@inlined(_start)
def _compile_start(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
    if hasattr(method.instance_class, "start"):
        return method.instance_class.start.py_func
    return lambda method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass: None


def _velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
    method.velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass)


@inlined(_velocity)
def _compile_velocity(method, effects, copy, x, v, history, f, effect_work, integrator_work, inverse_mass):
    return method.instance_class.velocity.py_func


@kernel
def _clear(f: Any, n: int) -> None:
    for t in range(n):
        f[t] = 0


@kernel
def _count_non_finite(bits: Any, exponent: Any, n: int) -> int:
    bad = 0
    for t in range(n):
        bad += (bits[t] & exponent) == exponent  # only NaN and infinity have all bits of the exponent set
    return bad


@jit
def _non_finite(a: Any) -> int:
    """How many numbers of a row are not finite, told by their bits: arithmetic may be compiled to assume that all are."""
    if a.itemsize == 8:
        return _count_non_finite(a.view(np.int64), np.int64(0x7FF0000000000000), a.shape[0])
    return _count_non_finite(a.view(np.int32), np.int32(0x7F800000), a.shape[0])


@jit
def first_non_finite(x: Any, v: Any) -> int:
    """Lowest particle with a non-finite position or velocity; -1 if there is none."""
    bad = 0
    for d in range(x.shape[0]):
        bad += _non_finite(x[d]) + _non_finite(v[d])
    if bad:
        for t in range(x.shape[1]):
            for d in range(x.shape[0]):
                if _non_finite(x[d, t : t + 1]) or _non_finite(v[d, t : t + 1]):
                    return t
    return -1


@jit
def _read(p: Any, w: Any, synchronous: Any, pinned: Any, axes: Any, positions: Any, velocities: Any) -> None:
    """Write positions and velocities, those of pinned particles from `w`, three entries a particle."""
    for d in range(p.shape[0]):
        for t in range(p.shape[1]):
            positions[3 * t + axes[d]] = p[d, t]
            velocities[3 * t + axes[d]] = synchronous[d, t]
        for k in range(pinned.shape[0]):
            velocities[3 * pinned[k] + axes[d]] = w[d, pinned[k]]


def make_run() -> Callable[..., Any]:
    """A function, not yet compiled, that advances many copies by many steps."""

    def run(
        method, effects, x, v, history, f, effect_work, integrator_work, inverse_mass, pinned, mast_targets, axes, stepped,
        failed_at, failed_particle, first, last, steps, read, positions, velocities,
    ):  # fmt: skip
        """Take `steps` steps of the copies `first <= copy < last` that have not failed, and put the pinned particles to where
        `mast` says; return how many run on. `failed_at` notes at which step one fails, and is 0 if that was in a call before.

        With `read`, write positions and velocities at the instant of the positions, (copies, 3 particles), afterwards.
        """
        healthy = 0
        for copy in range(first, last):
            p, w, m = x[copy], v[copy], history[copy]
            todo = steps if failed_at[copy] < 0 else 0
            if steps > 0 and failed_at[copy] > 0:
                failed_at[copy] = 0
            if todo > 0:
                if not stepped[copy]:
                    _start(method, effects, copy, p, w, m, f, effect_work, integrator_work, inverse_mass)
                stepped[copy] = True
            for i in range(todo):
                _step(method, effects, copy, p, w, m, f, effect_work, integrator_work, inverse_mass)
                project(effects, copy, p, w, effect_work, inverse_mass, method.seconds)
                advance(effects, copy, method.seconds)
                if (i + 1) % CHECK_EVERY == 0 or i + 1 == steps:
                    particle = first_non_finite(p, w)
                    if particle >= 0:
                        failed_at[copy] = i + 1
                        failed_particle[copy] = particle
                        break
            if failed_at[copy] < 0:
                healthy += 1
                if todo > 0:
                    for d in range(p.shape[0]):
                        for k in range(pinned.shape[0]):
                            p[d, pinned[k]] = mast_targets[copy, d, k]
            if read:
                if stepped[copy]:
                    _velocity(method, effects, copy, p, w, m, f, effect_work, integrator_work, inverse_mass)
                    _read(p, w, f, pinned, axes, positions[copy], velocities[copy])
                else:
                    _read(p, w, w, pinned, axes, positions[copy], velocities[copy])
        return healthy

    return run


def compiled_run(method: Any, effects: tuple[Any, ...]) -> Callable[..., int]:
    """Entry point that advances many copies by many steps, for a method and effects of these types; kept on disk."""
    return compiled_for(make_run, method, effects)


def compiled_for(make: Callable[[], Callable[..., Any]], method: Any, effects: tuple[Any, ...]) -> Callable[..., Any]:
    """The entry point that `make` makes, for a method and effects of these types; kept on disk."""
    return _for_modules(make, tuple([type(data).__module__ for data in (method, *effects)]))


@cache
def _for_modules(make: Callable[[], Callable[..., Any]], modules: tuple[str, ...]) -> Callable[..., Any]:
    return _for_sources(make, _foreign_sources(modules))


@cache
def _for_sources(make: Callable[[], Callable[..., Any]], sources: frozenset[Path] | None) -> Callable[..., Any]:
    return cached(make(), sources)


@cache
def _foreign_sources(modules: tuple[str, ...]) -> frozenset[Path] | None:
    """Files of effects from outside this package and of the kernels that they import; None if one has no file."""
    here = __name__.rpartition(".compiling.")[0]
    members = [value for name in modules for value in vars(sys.modules[name]).values()]
    called = {value.py_func.__module__ for value in members if hasattr(value, "py_func")}
    try:
        return frozenset(
            Path(inspect.getsourcefile(sys.modules[name]) or "")
            for name in {*modules, *called}
            if name != here and not name.startswith(here + ".")
        )
    except (TypeError, KeyError):
        return None
