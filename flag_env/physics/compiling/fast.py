"""How Python kernels become machine code by Numba's inside: half the time of `plain`, which takes over where a name has gone.

What `glue` and `loop` compile of the package's own becomes part of entry points (see `parts`) and is kept on disk too: a new
combination of effects compiles only what joins them.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.caching import NullCache
from numba.core.compiler import Compiler, CompilerBase, CompileResult
from numba.core.serialize import dumps

from flag_env.physics.compiling.cache import PHYSICS, source_digest
from flag_env.physics.compiling.disk_cache import cache_root, keep_on_disk, load_from_disk, warn
from flag_env.physics.compiling.parts import Glue, Kernel, NoAlias, Part, rebuilt

FLAGS = {"error_model": "numpy", "nogil": True, "_nrt": False}
"""Numba's options for everything compiled here."""

OVERLOAD = {"jit_options": {**FLAGS, "forceinline": True, "pipeline_class": Glue}}
"""Those of `numba.extending.overload` for glue that is written into its callers: to hand a call all the arrays costs more than
most glue does."""


_TRIED = 0, 68
"""Newest version of Numba that this was written for; what comes after is tried with care."""


def glue(function: Any) -> Any:
    """Dispatcher of a function whose array arguments may overlap."""
    return _dispatcher(function, Glue, Compiler)


def loop(function: Any) -> Any:
    """Dispatcher of a function none of whose written arrays overlaps another argument."""
    return _dispatcher(function, Kernel, NoAlias)


def _dispatcher(function: Any, part: type[CompilerBase], whole: type[CompilerBase]) -> Any:
    """A part of entry points, kept on disk, if the function is this package's own."""
    if not Path(function.__code__.co_filename).is_relative_to(PHYSICS):
        return numba.njit(**FLAGS, pipeline_class=whole)(function)
    options = {**FLAGS, "forceinline": part is Kernel, "nopython": True, "boundscheck": None}
    dispatcher = Part(function, targetoptions=options, pipeline_class=part)
    dispatcher._cache = _Cache(function, (), rebuilt)
    return dispatcher


def entry(function: Any, extra_sources: tuple[Path, ...] | None) -> Any:
    """Dispatcher of an entry point, kept on disk if all its sources are known."""
    dispatcher = numba.njit(**FLAGS, no_cfunc_wrapper=True)(function)
    if extra_sources is not None:
        dispatcher._cache = _Cache(function, extra_sources, _rebuilt)
    return dispatcher


def machine_code(dispatcher: Any, signature: tuple[Any, ...]) -> Any:
    """What Numba compiles for arguments of these types."""
    return dispatcher.compile(signature)


def _rebuilt(target: Any, payload: tuple[Any, ...]) -> Any:
    """Numba's record of an entry point kept on disk."""
    return CompileResult._rebuild(target, *payload)


class _Cache(NullCache):  # type: ignore[misc]
    """What Numba asks for a function's machine code and hands it to; a file for each signature, and no index to go wrong.

    It touches no file before something is compiled. Whatever cannot be read, or rebuilt, is compiled anew and kept in its place.
    """

    def __init__(self, function: Any, extra_sources: tuple[Path, ...], rebuild: Callable[[Any, Any], Any]) -> None:
        self._function, self._extra_sources, self._rebuild = function, extra_sources, rebuild

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for these types; None if it is not kept."""
        file = self._file(sig, target_context.codegen())
        content = None if file is None else load_from_disk(file)
        if content is None:
            return None
        target_context.refresh()
        try:
            key, payload = pickle.loads(content)
            return self._rebuild(target_context, payload) if key == self._key(sig, target_context.codegen()) else None
        except Exception as error:  # written by versions that the digest of sources does not tell apart, or by who knows whom
            warn(f"{file} cannot be used ({error!r}), and is made anew")
            return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep the compiled function, unless it holds addresses of this process or is for types from outside the package."""
        if not self._extra_sources and any(_from_outside(kind) for kind in cres.signature.args):
            return  # another process need not know those types
        file = self._file(sig, cres.codegen)
        if file is not None and not cres.lifted and not cres.library.has_dynamic_globals:
            keep_on_disk(file, dumps((self._key(sig, cres.codegen), cres._reduce())))

    def _key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """What the code depends on besides the sources: types, processor, bytecode and what a closure holds."""
        return sig, codegen.magic_tuple(), self._own

    def _file(self, sig: Any, codegen: Any) -> Path | None:
        """Where the code is kept; None where nothing is. Types of one name share a file, which tells whose it is."""
        folder = self._folder
        if folder is None:
            return None
        function, digest = self._function, hashlib.sha256(str(self._key(sig, codegen)).encode()).hexdigest()[:20]
        return folder / f"{function.__module__}.{function.__qualname__.replace('<', '').replace('>', '')}-{digest}.code"

    @cached_property
    def _own(self) -> str:
        cells = tuple(cell.cell_contents for cell in self._function.__closure__ or ())
        return hashlib.sha256(self._function.__code__.co_code + (dumps(cells) if cells else b"")).hexdigest()

    @cached_property
    def _folder(self) -> Path | None:
        root = cache_root()
        try:
            return None if root is None else root / source_digest(self._extra_sources)
        except OSError as error:
            warn(f"a source cannot be read ({error})")
            return None


def _from_outside(kind: Any) -> bool:
    """Whether a type is, or holds, a NamedTuple that is defined outside the package."""
    if isinstance(kind, numba.types.BaseNamedTuple) and not kind.instance_class.__module__.startswith("flag_env."):
        return True
    return isinstance(kind, numba.types.BaseTuple) and any(_from_outside(part) for part in kind)


def _add(a: Any, b: Any, n: int) -> None:
    for t in range(n):
        a[t] += b[t]


def _test_part(a: Any, b: Any) -> int:
    _test_loop(a[1:], b, b.shape[0])
    return len(a)


def _test_entry(a: Any, b: Any) -> int:
    return _test_glue(a, b) + 1  # type: ignore[no-any-return]


def check() -> None:
    """See, once for a folder of code, whether parts and an entry point do as they should, as compiled and as kept.

    Raises what Numba raises, RuntimeError if they do not, and CalledProcessError where a version that this was not written for
    fails or crashes: such a one is seen in a process of its own first.
    """
    root = cache_root()
    mark = None if root is None else root / source_digest() / "fast"
    if mark is not None and mark.exists():
        return
    if tuple(int(number) for number in numba.__version__.split(".")[:2]) > _TRIED:
        command = [sys.executable, "-c", f"from {__name__} import try_out; try_out()"]
        environment = {**os.environ, "FLAG_ENV_COMPILING": "plain", "PYTHONPATH": os.pathsep.join(sys.path)}
        subprocess.run(command, env=environment, check=True, capture_output=True, timeout=120)
    try_out()
    if mark is not None:
        try:
            mark.parent.mkdir(exist_ok=True)
            mark.touch()
        except OSError as error:
            warn(f"{mark} cannot be written ({error})")


def try_out() -> None:
    """Compile parts and an entry point, use them as compiled and as kept; raises RuntimeError if what they compute is wrong."""
    global _test_loop, _test_glue
    for kept in (None, (), ()):  # all compiled; parts read from disk; the entry point read from disk
        _test_loop, _test_glue = loop(_add), glue(_test_part)
        a, b = np.zeros(4), np.arange(3.0)
        code = machine_code(entry(_test_entry, kept), (numba.typeof(a), numba.typeof(b)))
        if code(a, b) != 5 or a.tolist() != [0.0, 0.0, 1.0, 2.0]:
            raise RuntimeError("code compiled by Numba's inside is wrong")


_test_loop: Any = None
_test_glue: Any = None
