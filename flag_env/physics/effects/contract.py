"""Checks effects from outside the package when a scene is made, so that a mistake is told by its name and not by the compiler."""

from __future__ import annotations

import difflib
import inspect
from typing import Any

import numpy as np

from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.effects.links import link_groups
from flag_env.physics.lattice import Lattice

HOOKS = {
    "force": "force(data, copy, x, v, f, effect_work, lag)",
    "project": "project(data, copy, x, v, effect_work, inverse_mass, seconds)",
    "advance": "advance(data, copy, seconds)",
    "pull_back": "pull_back(data, copy, x, v, g, dx, dv, effect_work, lag)",
    "slopes": "slopes(data, copy, x, v, g, out, effect_work, lag)",
}
"""The compiled hooks and their signatures; the first argument is the data."""

ACTING = {"force", "project", "advance"}
"""Those of which an effect must have one; the others carry derivatives back."""

_NEAR = 0.7
"""Likeness from which on another name counts as a misspelt hook."""

_accepted: set[type] = set()
"""Data types whose hooks have been accepted."""


def check_contract(effect: Effect, lattice: Lattice, dtype: str) -> None:
    """Raise TypeError or ValueError, naming effect, hook and signature, if an effect cannot take part in a scene."""
    kind = type(effect)
    if kind.__module__.startswith(__name__.rpartition(".")[0] + "."):
        return
    for method, signature in (("bind", "bind(self, context)"), ("linear_bound", "linear_bound(self, lattice)")):
        if getattr(kind, method) is getattr(Effect, method):
            raise TypeError(f"effect {kind.__name__} must define {signature}")
    _check_bound(effect, lattice)
    links = link_groups(lattice, (effect,), 1, np.dtype(dtype))
    _check_data(effect, effect.bind(BindContext(lattice, np.dtype(dtype), 1, 1e-3, 0, links)))


def _check_bound(effect: Effect, lattice: Lattice) -> None:
    bound, name = effect.linear_bound(lattice), type(effect).__name__
    if not isinstance(bound, LinearBound):
        raise TypeError(f"linear_bound(lattice) of effect {name} must return a LinearBound, got {bound!r}")
    values = [("stiffness", bound.stiffness, lattice.size), ("drag", bound.drag, lattice.size)]
    for term in bound.links:
        size = lattice.size - term.family.offset
        values += [("links' stiffness", term.stiffness, size), ("links' viscosity", term.viscosity, size)]
    for what, value, size in values:
        if value is None:
            continue
        if np.shape(value) != (size,):
            raise ValueError(
                f"{what} in linear_bound(lattice) of effect {name} must have the shape ({size},), got {np.shape(value)}"
            )
        if not (np.isfinite(value).all() and np.min(value, initial=0.0) >= 0.0):
            raise ValueError(f"{what} in linear_bound(lattice) of effect {name} must be finite and >= 0, got {value!r}")


def _check_data(effect: Effect, data: Any) -> None:
    name, kind = type(effect).__name__, type(data)
    if not (isinstance(data, tuple) and hasattr(kind, "_fields")):
        raise TypeError(f"bind(context) of effect {name} must return a NamedTuple whose type has the hooks, got {data!r}")
    _check_fields(name, data)
    if kind in _accepted:
        return
    callables = [attribute for attribute in vars(kind) if not attribute.startswith("_") and callable(getattr(kind, attribute))]
    for attribute in callables:
        near = difflib.get_close_matches(attribute, HOOKS, 1, _NEAR)
        if near and attribute not in HOOKS:
            raise TypeError(f"effect {name} has no hook {attribute!r} to offer; did you mean {HOOKS[near[0]]}?")
    hooks = [hook for hook in HOOKS if hasattr(kind, hook)]
    if not set(hooks) & ACTING:
        acting = (signature for hook, signature in HOOKS.items() if hook in ACTING)
        raise TypeError(f"effect {name} must have a hook on {kind.__name__}: {' or '.join(acting)}")
    for hook in hooks:
        function = getattr(kind, hook)
        if not hasattr(function, "py_func") and not _uncompiled():
            raise TypeError(
                f"hook {hook} of effect {name} must be compiled: @staticmethod, then @jit of flag_env.physics.compiling"
            )
        given = len(inspect.signature(getattr(function, "py_func", function)).parameters)
        if given != HOOKS[hook].count(",") + 1:
            raise TypeError(f"hook {hook} of effect {name} must take {HOOKS[hook]}, got {given} arguments")
    _accepted.add(kind)


def _check_fields(name: str, data: Any) -> None:
    """Every field must be of a type that Numba can compile for."""
    from numba import typeof  # a scene without effects from outside loads no compiler

    for field, value in data._asdict().items():
        try:
            typeof(value)
        except ValueError:
            raise TypeError(
                f"field {field!r} of {type(data).__name__} of effect {name} must be a number, an array of numbers or a "
                f"NamedTuple of such, which Numba can compile for, got {value!r}"
            ) from None


def _uncompiled() -> bool:
    from numba import config

    return bool(config.DISABLE_JIT)
