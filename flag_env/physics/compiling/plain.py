"""How Python kernels become machine code with what Numba documents alone: `njit`, `intrinsic`, `cache=True`.

Its code computes the same bits, as fast, as that of `fast`. To compile takes two to three times as long, and only entry points
are kept on disk: a new combination of effects is compiled as a whole.
"""

from __future__ import annotations

import inspect
import shutil
from functools import update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from llvmlite import ir
from numba.extending import intrinsic

from flag_env.physics.compiling.cache import source_digest
from flag_env.physics.compiling.disk_cache import cache_root, warn

FLAGS = {"error_model": "numpy", "nogil": True}
"""Numba's options for everything compiled here."""

OVERLOAD = {"jit_options": {**FLAGS, "forceinline": True}}
"""Those of `numba.extending.overload` for glue that is written into its callers."""


@intrinsic
def _no_overlap(typing_context: Any) -> Any:
    """Tell LLVM that no pointer argument of the function around it overlaps another."""
    del typing_context

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del signature, arguments
        for argument in builder.function.args:
            if isinstance(argument.type, ir.PointerType):
                argument.add_attribute("noalias")
        return context.get_dummy_value()

    return numba.types.void(), generate


def glue(function: Any) -> Any:
    """Dispatcher of a function whose array arguments may overlap."""
    return numba.njit(**FLAGS)(function)


def loop(function: Any) -> Any:
    """Dispatcher of a function none of whose written arrays overlaps another argument."""
    if numba.config.DISABLE_JIT:
        return function
    names = ", ".join(inspect.signature(function).parameters)
    parts = {"no_overlap": _no_overlap, "body": numba.njit(**FLAGS, inline="always")(function)}
    exec(f"def {function.__name__}({names}):\n    no_overlap()\n    return body({names})", parts)
    return numba.njit(**FLAGS, forceinline=True)(update_wrapper(parts[function.__name__], function))


def entry(function: Any, extra_sources: tuple[Path, ...] | None) -> Any:
    """Dispatcher of an entry point, kept on disk if all its sources are known."""
    kept = None if extra_sources is None or numba.config.DISABLE_JIT else _at_home(function, extra_sources)
    try:
        return numba.njit(**FLAGS, cache=kept is not None)(kept or function)
    except (OSError, RuntimeError) as error:  # Numba finds no place
        warn(f"compiled code cannot be read or kept ({error!r})")
        return numba.njit(**FLAGS)(function)


def _at_home(function: Any, extra_sources: tuple[Path, ...]) -> Any:
    """The function as if defined in the folder of its sources' digest: there Numba keeps its code, and never renews it."""
    root = cache_root()
    if root is None:
        return None
    file = root / source_digest(extra_sources) / "plain" / f"{function.__module__}.py"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch(exist_ok=True)
    except OSError as error:
        warn(f"compiled code cannot be read or kept ({error!r})")
        return None
    code = function.__code__.replace(co_filename=str(file))
    return update_wrapper(FunctionType(code, function.__globals__, closure=function.__closure__), function)


def machine_code(dispatcher: Any, signature: tuple[Any, ...]) -> Any:
    """What Numba compiles for arguments of these types; files that are damaged or cannot be written do not matter."""
    for _ in range(2):
        try:
            return dispatcher.compile(signature)
        except numba.errors.NumbaError:
            raise
        except Exception as error:
            warn(f"compiled code cannot be read or kept ({error!r})")
            if signature not in dispatcher.signatures:  # not even compiled: what was kept is damaged
                shutil.rmtree(dispatcher.stats.cache_path or "", ignore_errors=True)
    return numba.njit(**FLAGS)(dispatcher.py_func).compile(signature)
