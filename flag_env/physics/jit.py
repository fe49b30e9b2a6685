"""The project's Numba decorators and its source-keyed cache of compiled code.

Three decorators, all with IEEE arithmetic, NumPy's error model and no GIL:

* `jit`: code that glues kernels together; its array arguments may overlap.
* `kernel`: a loop over plain arrays. No array that it writes may overlap another argument. LLVM is told so (`noalias`), drops
  its run-time overlap checks and vectorises every loop: twice the speed on a small flag.
* `cached`: an entry point whose machine code is kept on disk, even where effects from outside take part.

What `jit` and `kernel` compile of the package's own becomes part of entry points (see `compiler`) and is kept on disk too: a new
combination of effects compiles only what joins them.

No fast-math: additions keep their order and NaN keeps its meaning, so every machine computes the same bits.

Numba renews a cached function only when the function's own file changes, although the machine code contains every kernel that
it calls. Here the cache directory's name is a digest of all sources that take part, so edited code is never served stale.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache, _CacheLocator
from numba.core.compiler import Compiler, CompilerBase

from flag_env.physics.compiler import Glue, Kernel, NoAlias, Part, rebuilt

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent

FLAGS = {"error_model": "numpy", "nogil": True, "_nrt": False}
"""Numba's options for everything compiled here."""

INLINED = {**FLAGS, "forceinline": True, "pipeline_class": Glue}
"""Those for glue that is written into its callers: to hand a call all the arrays costs more than most glue does."""


def jit(function: F) -> F:
    """Compile glue code, whose array arguments may overlap."""
    return _compiled(function, Glue, Compiler)  # type: ignore[no-any-return]


def kernel(function: F) -> F:
    """Compile a loop none of whose written arrays overlaps another argument."""
    return _compiled(function, Kernel, NoAlias)  # type: ignore[no-any-return]


def _compiled(function: Any, part: type[CompilerBase], whole: type[CompilerBase]) -> Any:
    """A part of entry points, kept on disk, if the function is this package's own."""
    if numba.config.DISABLE_JIT or not Path(function.__code__.co_filename).is_relative_to(_PACKAGE):
        return numba.njit(**FLAGS, pipeline_class=whole)(function)
    options = {**FLAGS, "forceinline": part is Kernel, "nopython": True, "boundscheck": None}
    dispatcher = Part(function, targetoptions=options, pipeline_class=part)
    dispatcher._cache = _SourceKeyedCache(function, (), _PartFiles)
    return dispatcher


def cached(function: F, extra_sources: Iterable[Path] | None = ()) -> F:
    """Compile an entry point and keep the machine code on disk.

    Parameters
    ----------
    function
        A function that no other dispatcher was made from.
    extra_sources
        Source files outside `flag_env.physics` whose code is compiled in; None where they have no file: then nothing is kept.
    """
    dispatcher = numba.njit(**FLAGS, no_cfunc_wrapper=True)(function)
    if extra_sources is not None and dispatcher is not function:
        dispatcher._cache = _SourceKeyedCache(function, tuple(sorted(extra_sources)), _Files)
    return dispatcher  # type: ignore[no-any-return]


def entry_point(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Callable[..., Any]:
    """Machine code of a compiled function for arguments of these types, called without Numba's look at their types.

    That look takes 7 us for the arguments of a scene, the call itself one. The caller vouches that the types stay.
    """
    if not hasattr(function, "typeof_pyval"):
        return function  # NUMBA_DISABLE_JIT
    return function.compile(tuple(function.typeof_pyval(argument) for argument in arguments))  # type: ignore[attr-defined, no-any-return]


@lru_cache
def source_digest(extra: tuple[Path, ...] = ()) -> str:
    """Hexadecimal digest of the package's physics sources, of `extra` files and of the compiler's version."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for path in (*sorted(_PACKAGE.rglob("*.py")), *extra):
        digest.update(str(path.name).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:20]


@lru_cache(maxsize=1)
def cache_root() -> Path | None:
    """First writable place for compiled code: `NUMBA_CACHE_DIR`, the user's cache folder, the temporary folder."""
    places = []
    if os.environ.get("NUMBA_CACHE_DIR"):
        places.append(Path(os.environ["NUMBA_CACHE_DIR"]))
    if os.environ.get("LOCALAPPDATA"):
        places.append(Path(os.environ["LOCALAPPDATA"]))
    places.append(Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()))
    places.append(Path(tempfile.gettempdir()) / f"cache-{os.getuid() if hasattr(os, 'getuid') else 'user'}")
    for place in places:
        root = place / "flag_env"
        try:
            root.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=root):
                return root
        except OSError:
            continue
    return None


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Places a function's cache in a folder named after the digest of its sources."""

    def __init__(self, key: str, name: str) -> None:
        self._key = key
        self._name = name
        self._py_file = str(_PACKAGE)

    def get_cache_path(self) -> str:
        return str((cache_root() or Path(tempfile.gettempdir())) / self._key)

    def get_source_stamp(self) -> str:
        return self._key

    def get_disambiguator(self) -> str:
        return self._name

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        del py_file
        return cls(py_func.__cache_key__, f"{py_func.__module__}.{py_func.__code__.co_firstlineno}")


class _Impl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = [_Locator]  # noqa: RUF012  (Numba's name and type)


class _PartImpl(_Impl):
    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        return rebuilt(target_context, payload)


class _Files(FunctionCache):  # type: ignore[misc]
    _impl_class = _Impl


class _PartFiles(FunctionCache):  # type: ignore[misc]
    _impl_class = _PartImpl


class _SourceKeyedCache(NullCache):  # type: ignore[misc]
    """A function's cache, which touches no file before something is compiled; nothing is kept where no folder is writable."""

    def __init__(self, function: Any, extra_sources: tuple[Path, ...], files: type[FunctionCache]) -> None:
        self._function, self._extra_sources, self._kind = function, extra_sources, files

    @cached_property
    def _files(self) -> Any:
        if cache_root() is None:
            return NullCache()
        self._function.__cache_key__ = source_digest(self._extra_sources)
        return self._kind(self._function)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return self._files.load_overload(sig, target_context)

    def save_overload(self, sig: Any, cres: Any) -> None:
        self._files.save_overload(sig, cres)
