"""The project's Numba decorators.

All compile with IEEE arithmetic, NumPy's error model and no GIL:

* `jit`: code that glues kernels together; its array arguments may overlap.
* `kernel`: a loop over plain arrays. No array that it writes may overlap another argument. LLVM is told so (`noalias`), drops
  its run-time overlap checks and vectorises every loop: twice the speed on a small flag.
* `cached`: an entry point whose machine code is kept on disk, even where effects from outside take part.
* `inlined`: glue that is chosen by the types of its arguments, written into its callers.

No fast-math: additions keep their order and NaN keeps its meaning, so every machine computes the same bits.

They compile in one of two ways, with the same bits and speed: "plain", with what Numba documents alone, or "fast", by its
inside, in half the time. Fast is taken where this version of Numba has what it needs, unless the environment variable
`FLAG_ENV_COMPILING` names one of them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.extending import overload

F = TypeVar("F", bound=Callable[..., Any])


def _way() -> Any:
    """The module that compiles: `fast` or `plain`."""
    name, package = os.environ.get("FLAG_ENV_COMPILING", ""), __name__.rpartition(".")[0]
    if name not in ("", "plain", "fast"):
        raise ValueError(f"FLAG_ENV_COMPILING must be 'plain', 'fast' or not set, got {name!r}")
    if name != "plain" and not numba.config.DISABLE_JIT:
        try:
            fast = import_module(f"{package}.fast")
            fast.check()
            return fast
        except Exception:  # a name has gone, or means something else
            if name == "fast":
                raise
    return import_module(f"{package}.plain")


_WAY = _way()

WAY: str = _WAY.__name__.rpartition(".")[2]
"""How this process compiles: "fast" or "plain"."""


def jit(function: F) -> F:
    """Compile glue code, whose array arguments may overlap."""
    return _WAY.glue(function)  # type: ignore[no-any-return]


def kernel(function: F) -> F:
    """Compile a loop none of whose written arrays overlaps another argument."""
    return _WAY.loop(function)  # type: ignore[no-any-return]


def inlined(stub: Callable[..., Any]) -> Callable[[F], F]:
    """Compile `stub` as the function that the decorated one returns for the types of its arguments, in the place of each call."""
    return overload(stub, strict=False, **_WAY.OVERLOAD)  # type: ignore[no-any-return]


def cached(function: F, extra_sources: Iterable[Path] | None = ()) -> F:
    """Compile an entry point and keep the machine code on disk.

    Parameters
    ----------
    function
        A function that no other dispatcher was made from.
    extra_sources
        Source files outside `flag_env.physics` whose code is compiled in; None where they have no file: then nothing is kept.
    """
    return _WAY.entry(function, None if extra_sources is None else tuple(sorted(extra_sources)))  # type: ignore[no-any-return]


def entry_point(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Callable[..., Any]:
    """Machine code of a compiled function for arguments of these types, called without Numba's look at their types.

    That look takes 7 us for the arguments of a scene, the call itself one. The caller vouches that the types stay.
    """
    if not hasattr(function, "compile"):
        return function  # NUMBA_DISABLE_JIT
    code = _WAY.machine_code(function, tuple(numba.typeof(argument) for argument in arguments))
    return code if callable(code) else function
