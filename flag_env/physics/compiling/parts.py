"""How the package's own kernels and the glue between them are compiled: as parts of the entry point that calls them.

Numba compiles every function for itself: it links in what the function calls, optimises all of it, turns it into machine code and
adds two wrappers through which Python may call it. Of a scene's many functions Python calls a single one, its entry point. The
others stop early. They have no wrappers and no machine code, and unless they are kernels are not optimised by themselves; they
stay LLVM bitcode, in memory and on disk, for the entry point to link in. Its code is as fast, and is there in half the time.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

from llvmlite import binding as llvm
from numba import _dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder, Flags, compile_result
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import InlineOverloads, NativeLowering, NopythonRewrites
from numba.core.untyped_passes import (
    FindLiterallyCalls,
    InlineClosureLikes,
    InlineInlinables,
    LiteralUnroll,
    MakeFunctionToJitFunction,
    WithLifting,
)

_UNUSED = frozenset(
    {
        FindLiterallyCalls, InlineClosureLikes, InlineInlinables, InlineOverloads, LiteralUnroll, MakeFunctionToJitFunction,
        NopythonRewrites, WithLifting,
    }
)  # fmt: skip
"""Numba's passes for what no part contains: closures, `with`, unrolling over types, inlining by Numba, whole-array arithmetic."""


class _Flags(Flags):  # type: ignore[misc]
    """Numba's flags, equal if the same ones are set: Numba compares them some 50 000 times, by default all 22 of them."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Flags) and bool(self._values == other._values)

    def __hash__(self) -> int:
        return hash(frozenset(self._values))


class _Optimised(JITCodeLibrary):  # type: ignore[misc]
    """Code for callers to link in."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """Name and bitcode."""
        self._ensure_finalized()
        return self.name, self._get_module_for_linking().as_bitcode()

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, bytes]) -> Any:
        name, bitcode = state
        library = cls(codegen, name)
        library._final_module = library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalize_final_module()
        return library


class _Raw(_Optimised):
    """A compiled function, left to its callers to optimise."""

    def _optimize_final_module(self) -> None:
        pass


class NoAlias(CompilerBase):  # type: ignore[misc]
    """Numba's usual pipeline with every pointer argument marked `noalias`, up to machine code."""

    def define_pipelines(self) -> list[Any]:
        """Numba's passes."""
        self.state.flags.noalias = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerPart(NativeLowering):  # type: ignore[misc]
    """Numba's lowering, which ends at LLVM code."""

    _name = "lower_part"

    def run_pass(self, state: Any) -> bool:
        """Lower, and make the result known to callers."""
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state.cr
        state.cr = lowered._replace(cfunc=_name_of(lowered.fndesc, lowered.env))
        state.targetctx.insert_user_function(state.cr.cfunc, lowered.fndesc, [state.library])
        return True


def _name_of(description: Any, environment: Any) -> Any:
    """What Numba knows a compiled function by: a builtin function, here one without machine code."""
    return _dynfunc.make_function(description.lookup_module(), description.qualname, "part of an entry point", 0, environment, ())


class Glue(CompilerBase):  # type: ignore[misc]
    """Numba's usual pipeline, which ends at code that has not been optimised."""

    _library: type[_Optimised] = _Raw

    def __init__(self, *arguments: Any) -> None:
        """As Numba does."""
        super().__init__(*arguments)
        self.state.flags = _Flags(self.state.flags)

    def define_pipelines(self) -> list[Any]:
        """Numba's passes, as far as parts need them, lowering replaced."""
        state = self.state
        state.library = self._library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = True
        pipeline = DefaultPassBuilder.define_nopython_pipeline(state)
        used = [(what, why) for what, why in pipeline.passes if what not in _UNUSED]
        pipeline.passes = [(_LowerPart if what is NativeLowering else what, why) for what, why in used]
        if sum(what is _LowerPart for what, _ in pipeline.passes) != 1:
            raise RuntimeError("Numba's pipeline has no lowering to replace")
        pipeline.finalize()
        return [pipeline]


class Kernel(Glue):
    """The same with every pointer argument marked `noalias`, and optimised."""

    _library = _Optimised

    def define_pipelines(self) -> list[Any]:
        """As for glue."""
        self.state.flags.noalias = True
        return super().define_pipelines()


class Part(CPUDispatcher):  # type: ignore[misc]
    """A function that compiled code calls as a part; called from Python it is compiled once more, as a whole."""

    @cached_property
    def _whole(self) -> Any:
        pipeline = NoAlias if issubclass(self._compiler.pipeline_class, Kernel) else Compiler
        return CPUDispatcher(self.py_func, targetoptions=self.targetoptions, pipeline_class=pipeline)

    def __call__(self, *arguments: Any) -> Any:
        """Call the whole."""
        return self._whole(*arguments)


def rebuilt(target: Any, payload: tuple[Any, ...]) -> Any:
    """Numba's record of a part kept on disk."""
    library, description, environment, signature, *_ = payload
    return compile_result(
        typing_context=target.typing_context,
        target_context=target,
        entry_point=_name_of(description, environment),
        library=_Optimised._unserialize(target.codegen(), library),
        signature=signature,
        objectmode=False,
        lifted=(),
        fndesc=description,
        environment=environment,
        reload_init=[],
    )
