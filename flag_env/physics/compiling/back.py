"""The way back: compiled code that carries derivatives of a loss from the end of a run to its start.

The way forward is that of `step`, and keeps the positions and velocities of every step. On the way back `dx, dv, dhistory` hold
the derivatives of the loss with respect to `x, v, history`. What effect data may offer for it:

`pull_back(data, copy, x, v, g, dx, dv, effect_work, lag)`
    where the loss has the derivatives `g` with respect to the effect's forces at `x` and `v`: adds those with respect to the
    positions to `dx` and to the velocities to `dv`, that is J' g of either Jacobian;
`parameters()`
    names of parameters of its description, numbers or triples of them; and with it
`slopes(data, copy, x, v, g, out, effect_work, lag)`
    adds the derivatives with respect to these parameters to `out`, float64, in this order.

What an integrator's data has for it: `back_rows()`, how many rows of work it needs; and with the same arguments

`step_back(method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag)`
    undoes a step: `x, v, history` from before it, `after` the velocities after it;
`velocity_back(...)`
    adds what follows from the velocities at the instant of the positions, whose derivatives stand in `after`;
`start_back(...)`, if it has a `start`
    undoes that: `v` from before it.

`history` has one row, the velocities of the step before: methods that remember anything else have no way back. `lag` counts from
the state that the effects' data hold.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from flag_env.physics.compiling.decorators import inlined, kernel
from flag_env.physics.compiling.step import _start, _step, _velocity, advance, compiled_for


def pull_back(
    effects: Any, slopes: Any, copy: int, x: Any, v: Any, felt: Any, g: Any, dx: Any, dv: Any, effect_work: Any, lag: float
) -> None:
    """Carry derivatives `g` with respect to the forces at `x` and `v` on to `dx`, `dv` and the parameters asked for.

    `slopes` has an entry for each effect: None, or an array of a row for each copy. `felt` are the velocities that dampers feel
    as their viscosity changes: `v`, or a mean over the step where a method solves for it.
    """
    for data, out in zip(effects, slopes, strict=True):
        data.pull_back(data, copy, x, v, g, dx, dv, effect_work, lag)
        if out is not None:
            data.slopes(data, copy, x, felt, g, out[copy], effect_work, lag)


@inlined(pull_back)
def _compile_pull_back(effects, slopes, copy, x, v, felt, g, dx, dv, effect_work, lag):
    names: dict[str, Any] = {}
    lines = ["def run(effects, slopes, copy, x, v, felt, g, dx, dv, effect_work, lag):"]
    for i, (data, out) in enumerate(zip(effects.types, slopes.types, strict=True)):
        names[f"pull_back_{i}"] = data.instance_class.pull_back
        lines.append(f"pull_back_{i}(effects[{i}], copy, x, v, g, dx, dv, effect_work, lag)")
        if not isinstance(out, types.NoneType):
            names[f"slopes_{i}"] = data.instance_class.slopes
            lines.append(f"slopes_{i}(effects[{i}], copy, x, felt, g, slopes[{i}][copy], effect_work, lag)")
    return _written([*lines, "return"], names)


def _blow(effects: Any, copy: int, amplitude: Any) -> None:
    """Give every wind this amplitude (3,)."""
    for data in effects:
        if hasattr(data, "wind"):
            data.wind.amplitude[copy] = amplitude


@inlined(_blow)
def _compile_blow(effects, copy, amplitude):
    lines = ["def run(effects, copy, amplitude):"]
    for i, data in enumerate(effects.types):
        if "wind" in data.instance_class._fields:
            lines.append(f"for d in range(3): effects[{i}].wind.amplitude[copy, d] = amplitude[d]")
    return _written([*lines, "return"], {})


def _collect(effects: Any, slopes: Any, copy: int, amplitude: Any) -> None:
    """Move the derivatives with respect to the winds' amplitudes, the last three of theirs, to `amplitude` (3,)."""
    for data, out in zip(effects, slopes, strict=True):
        if hasattr(data, "wind") and out is not None:
            amplitude += out[copy, -3:]
            out[copy, -3:] = 0.0


@inlined(_collect)
def _compile_collect(effects, slopes, copy, amplitude):
    lines = ["def run(effects, slopes, copy, amplitude):"]
    for i, (data, out) in enumerate(zip(effects.types, slopes.types, strict=True)):
        if "wind" in data.instance_class._fields and not isinstance(out, types.NoneType):
            last = f"slopes[{i}][copy, slopes[{i}].shape[1] - 3 + d]"
            lines += ["for d in range(3):", f"    amplitude[d] += {last}", f"    {last} = 0.0"]
    return _written([*lines, "return"], {})


def _written(lines: list[str], names: dict[str, Any]) -> Any:
    exec("\n    ".join(lines), names)
    return names["run"]


def _step_back(
    method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
):  # fmt: skip
    method.step_back(
        method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
    )  # fmt: skip


@inlined(_step_back)
def _compile_step_back(
    method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
):  # fmt: skip
    return method.instance_class.step_back.py_func


def _velocity_back(
    method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
):  # fmt: skip
    method.velocity_back(
        method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
    )  # fmt: skip


@inlined(_velocity_back)
def _compile_velocity_back(
    method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
):  # fmt: skip
    return method.instance_class.velocity_back.py_func


def _start_back(
    method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
):  # fmt: skip
    if hasattr(method, "start"):
        method.start_back(
            method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
        )  # fmt: skip


@inlined(_start_back)
def _compile_start_back(
    method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
):  # fmt: skip
    if hasattr(method.instance_class, "start"):
        return method.instance_class.start_back.py_func

    def nothing(
        method, effects, slopes, copy, x, v, history, after, dx, dv, dhistory, work, effect_work, inverse_mass, lag
    ):  # fmt: skip
        return

    return nothing


@kernel
def _keep(a: Any, b: Any, n: int) -> None:
    for d in range(b.shape[0]):
        for t in range(n):
            a[d, t] = b[d, t]


@kernel
def _keep_both(a: Any, b: Any, c: Any, d: Any, n: int) -> None:
    for i in range(b.shape[0]):
        for t in range(n):
            a[i, t] = b[i, t]
        for t in range(n):
            c[i, t] = d[i, t]


def make_record() -> Callable[..., Any]:
    """A function, not yet compiled, that goes forward over several legs and keeps what the way back needs."""

    def record(
        method, effects, x, v, history, f, effect_work, integrator_work, inverse_mass, pinned, stepped, legs, amplitudes, blow,
        targets, path, last_velocities, kept_x, kept_v, keep, first, last,
    ):  # fmt: skip
        """Take the steps of all legs, of the copies `first <= copy < last`.

        `legs` (legs, 5): steps, number of the action, steps of that action if it begins here or 0, 1 if it ends here, first step
        since the start. A beginning sets the wind's amplitudes (actions, copies, 3), with `blow`, and the velocities of the
        pinned particles towards `targets` (actions, copies, coordinates, pinned). An end puts them there, and writes the
        positions into `path` (actions, copies, coordinates, particles). After the last leg, write the velocities at the instant
        of the positions. With `keep`, step k of leg j, all legs in a row, is kept in `kept_x[copy, k + j]` and
        `kept_v[copy, k + 2 j + 1]`, the velocities of the step before its first at `kept_v[copy, 2 j]`.
        """
        number, n = x.dtype.type, x.shape[2]
        for copy in range(first, last):
            p, w, m = x[copy], v[copy], history[copy]
            at_x, at_v = 0, 0
            for j in range(legs.shape[0]):
                steps, action, whole = legs[j, 0], legs[j, 1], legs[j, 2]
                if whole > 0:
                    if blow:
                        _blow(effects, copy, amplitudes[action, copy])
                    for d in range(p.shape[0]):
                        for k in range(pinned.shape[0]):
                            gap = number(targets[action, copy, d, k]) - p[d, pinned[k]]
                            w[d, pinned[k]] = gap / number(whole * method.seconds)
                if not stepped[copy]:
                    _start(method, effects, copy, p, w, m, f, effect_work, integrator_work, inverse_mass)
                    stepped[copy] = True
                if keep and m.shape[0] > 0:
                    _keep(kept_v[copy, at_v], m[0], n)
                for i in range(steps):
                    if keep:
                        _keep_both(kept_x[copy, at_x + i], p, kept_v[copy, at_v + i + 1], w, n)
                    _step(method, effects, copy, p, w, m, f, effect_work, integrator_work, inverse_mass)
                    advance(effects, copy, method.seconds)
                if legs[j, 3] > 0:
                    for d in range(p.shape[0]):
                        for k in range(pinned.shape[0]):
                            p[d, pinned[k]] = targets[action, copy, d, k]
                    _keep(path[action, copy], p, n)
                if keep:
                    _keep_both(kept_x[copy, at_x + steps], p, kept_v[copy, at_v + steps + 1], w, n)
                at_x += steps + 1
                at_v += steps + 2
            _velocity(method, effects, copy, p, w, m, f, effect_work, integrator_work, inverse_mass)
            _keep(last_velocities[copy], f, n)
            for d in range(p.shape[0]):
                for k in range(pinned.shape[0]):
                    last_velocities[copy, d, pinned[k]] = w[d, pinned[k]]

    return record


def make_back() -> Callable[..., Any]:
    """A function, not yet compiled, that goes back over the legs that `make_record` has kept."""

    def back(
        method, effects, slopes, kept_x, kept_v, start_v, fresh, dpath, dvelocities, dx, dv, dhistory, dtargets, damplitudes,
        work, effect_work, inverse_mass, pinned, legs, amplitudes, blow, at_end, at_start, first, last,
    ):  # fmt: skip
        """Undo the steps of all legs, of the copies `first <= copy < last`; see `make_record` for the legs and what was kept.

        `dpath` (actions, copies, coordinates, particles) joins `dx` where an action ends, and with `at_end` `dvelocities`
        (copies, coordinates, particles) at the very end. Derivatives with respect to mast and wind go to `dtargets` and
        `damplitudes`. With `at_start`, the start of copies that were `fresh` is undone too.
        """
        for copy in range(first, last):
            a, b, c = dx[copy], dv[copy], dhistory[copy]
            at_x, at_v = 0, 0
            for j in range(legs.shape[0]):
                at_x += legs[j, 0] + 1
                at_v += legs[j, 0] + 2
            for back_j in range(legs.shape[0]):
                j = legs.shape[0] - 1 - back_j
                steps, action, whole, since = legs[j, 0], legs[j, 1], legs[j, 2], legs[j, 4]
                at_x -= steps + 1
                at_v -= steps + 2
                if blow:
                    _blow(effects, copy, amplitudes[action, copy])
                if legs[j, 3] > 0:
                    for d in range(a.shape[0]):
                        for t in range(a.shape[1]):
                            a[d, t] += dpath[action, copy, d, t]
                    if at_end and back_j == 0:
                        _velocity_back(
                            method, effects, slopes, copy, kept_x[copy, at_x + steps], kept_v[copy, at_v + steps + 1],
                            kept_v[copy, at_v + steps], dvelocities[copy], a, b, c, work, effect_work, inverse_mass,
                            (since + steps) * method.seconds,
                        )  # fmt: skip
                    for d in range(a.shape[0]):
                        for k in range(pinned.shape[0]):
                            dtargets[action, copy, d, k] += a[d, pinned[k]]
                            a[d, pinned[k]] = 0
                for back_i in range(steps):
                    i = steps - 1 - back_i
                    _step_back(
                        method, effects, slopes, copy, kept_x[copy, at_x + i], kept_v[copy, at_v + i + 1],
                        kept_v[copy, at_v + i], kept_v[copy, at_v + i + 2], a, b, c, work, effect_work, inverse_mass,
                        (since + i) * method.seconds,
                    )  # fmt: skip
                if at_start and j == 0 and fresh[copy]:
                    _start_back(
                        method, effects, slopes, copy, kept_x[copy, at_x], start_v[copy], start_v[copy], start_v[copy],
                        a, b, c, work, effect_work, inverse_mass, since * method.seconds,
                    )  # fmt: skip
                    c[:] = 0
                if whole > 0:
                    for d in range(a.shape[0]):
                        for k in range(pinned.shape[0]):
                            pull = b[d, pinned[k]] / (whole * method.seconds)
                            dtargets[action, copy, d, k] += pull
                            a[d, pinned[k]] -= pull
                            b[d, pinned[k]] = 0
                            if c.shape[0] > 0:
                                c[0, d, pinned[k]] = 0
                    if blow:
                        _collect(effects, slopes, copy, damplitudes[action, copy])

    return back


def compiled_record(method: Any, effects: tuple[Any, ...]) -> Callable[..., None]:
    """Entry point that goes forward and keeps every step, for a method and effects of these types; kept on disk."""
    return compiled_for(make_record, method, effects)


def compiled_back(method: Any, effects: tuple[Any, ...]) -> Callable[..., None]:
    """Entry point that goes back, for a method and effects of these types; kept on disk."""
    return compiled_for(make_back, method, effects)
