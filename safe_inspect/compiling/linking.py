# mypy: disable-error-code="attr-defined,misc,no-untyped-call,valid-type"
"""How kernels are compiled: once for each that Python calls, together with all that it calls.

Numba optimises a compiled function by itself, writes its machine code, and does both again for each function that calls
it, for it is linked into the caller. A kernel that is called by kernels alone needs neither: its intermediate code is
kept, and linked once into each kernel that Python calls (`WholeCompiler`), where all is optimised together.

This file belongs to the sources of compiled functions (those with ``@njit``): a change of it removes what is cached.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

from llvmlite import binding
from llvmlite.binding.newpassmanagers import create_new_module_pass_manager
from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, compile_result
from numba.core.environment import lookup_environment

from safe_inspect.compiling.folders import digest_of, user_folder

_ENVIRONMENT = "_ZN08NumbaEnv"
#: How the names of compiled functions begin.
_MANGLED = "_ZN"


class _Unplaced:
    """In place of a code generator: code that is not in memory has no environment to be told."""

    def set_env(self, name: str, env: Any) -> None:
        """Do nothing."""


class PartLibrary(JITCodeLibrary):
    """Intermediate code of a kernel that kernels call. It is never run by itself.

    Attributes:
        origin: The kernel, and the signature that it is compiled for.
    """

    origin: tuple[Any, Any]

    @property
    def codegen(self) -> Any:
        """What sets the environment when the code is loaded: nothing."""
        return _Unplaced()

    @classmethod
    def loaded(cls, codegen: Any, name: str, bitcode: bytes, parts: Iterable[PartLibrary]) -> PartLibrary:
        """Return the library of `bitcode`, which calls other parts."""
        library = cls(codegen, name)
        library._final_module, library._finalized = binding.parse_bitcode(bitcode), True
        library._linking_libraries += parts
        return library

    @property
    def parts(self) -> list[PartLibrary]:
        """The parts that it calls."""
        return list(dict.fromkeys(each for each in self._linking_libraries if isinstance(each, PartLibrary)))

    @property
    def complete(self) -> bool:
        """Whether the parts that it calls are those that it was compiled with."""
        wanted: set[str] = set()
        found: set[str] = set()
        for function in self._final_module.functions:
            (wanted if function.is_declaration else found).add(function.name)
        for part in self.parts:
            found |= {function.name for function in part._final_module.functions if not function.is_declaration}
        return all(name in found for name in wanted if name.startswith(_MANGLED))

    @property
    def bitcode(self) -> bytes:
        """The code, together with what it calls that is no part."""
        module = self._get_module_for_linking().clone()
        for library in dict.fromkeys(self._linking_libraries):
            if not isinstance(library, PartLibrary):
                module.link_in(library._get_module_for_linking(), preserve=True)
        result: bytes = module.as_bitcode()
        return result

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Keep the code as it is."""
        self._raise_if_finalized()
        passes = create_new_module_pass_manager()
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
        passes.add_aggressive_dce_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(self._final_module, self._codegen._pass_builder())
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = binding.Linkage.linkonce_odr
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        self._ensure_finalized()
        return self._final_module

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code."""
        self._ensure_finalized()
        return 0


class WholeLibrary(JITCodeLibrary):
    """Machine code of a kernel that Python calls, with all that it calls."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.is_declaration and function.name.startswith(_MANGLED):
                raise AssertionError(f"{self.name} calls {function.name}, which is not linked")
            if function.linkage == binding.Linkage.linkonce_odr:
                function.linkage = binding.Linkage.internal  # of this kernel alone
        super()._optimize_final_module()

    def finalize(self) -> None:
        """Link, optimise and write the machine code."""
        self._linking_libraries = called_by(self)
        super().finalize()
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                env = lookup_environment(variable.name)
                if env is not None:
                    self._codegen.set_env(variable.name, env)


def called_by(library: Any) -> list[Any]:
    """Return the libraries that a library calls, directly or through parts, each once and before what it calls.

    LLVM links a function that is not called yet as if it were not there.
    """
    found: dict[Any, None] = {}

    def visit(library: Any) -> None:
        for called in library._linking_libraries:
            if called not in found:
                if isinstance(called, PartLibrary):
                    visit(called)
                found.setdefault(called)

    visit(library)
    return list(found)[::-1]


class WholeCompiler(Compiler):
    """Compiles kernels that Python calls."""

    _library: type[JITCodeLibrary] = WholeLibrary

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        self.state.library = self._library(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


class PartCompiler(WholeCompiler):
    """Compiles kernels that kernels call."""

    _library = PartLibrary

    def __init__(
        self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any, locals: Any
    ) -> None:
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)

    def _compile_bytecode(self) -> Any:
        """Compile the function, by a name that another process gives it too."""
        identity = self.state.func_id
        if "<locals>" not in identity.func_qualname and identity.modname != "__main__":
            identity.unique_id, identity.unique_name = "part", f"{identity.func_qualname}$part"
        return super()._compile_bytecode()


class _Locator(CompileResultCacheImpl._locator_classes[1]):
    """Keeps machine code in the user's folder."""

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(user_folder(digest_of()) / self.get_suitable_cache_subpath(file))


class _WholeFiles(CompileResultCacheImpl):
    """Writes and reads machine code."""

    # NUMBA_CACHE_DIR, or beside the source; Numba's own folder would keep what an update of the package changes
    _locator_classes = [*CompileResultCacheImpl._locator_classes[:2], _Locator]  # noqa: RUF012


class _PartFiles(_WholeFiles):
    """Writes and reads what `PartCompiler` gives."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Return another name than that of the same kernel when Python calls it."""
        return f"{super().get_filename_base(fullname, abiflags)}.part"

    def reduce(self, result: Any) -> Any:
        """Return what is written."""
        library = result.library
        result.fndesc.typemap = result.fndesc.calltypes = None  # large, and not needed any more
        return (
            library.name, library.bitcode, [part.origin for part in library.parts], result.fndesc,
            result.environment, result.signature, str(result.type_annotation), result.reload_init,
        )  # fmt: skip

    def rebuild(self, target_context: Any, written: Any) -> Any:
        """Return what was written; None when it no longer fits what it calls."""
        name, bitcode, origins, fndesc, environment, signature, annotation, reload_init = written
        for function in reload_init:
            function()
        parts = []
        for kernel, compiled in origins:
            kernel.part.compile(tuple(compiled.args))
            called = kernel.part.overloads[tuple(compiled.args)]
            if called.signature != compiled:
                return None  # it has changed, and what it returns with it
            parts.append(called.library)
        library = PartLibrary.loaded(target_context.codegen(), name, bitcode, parts)
        return compile_result(
            target_context=target_context,
            environment=environment,
            entry_point=target_context.get_executable(library, fndesc, environment),
            library=library,
            fndesc=fndesc,
            type_annotation=annotation,
            signature=signature,
            objectmode=False,
            lifted=(),
            reload_init=reload_init,
        )


class _WholeCache(FunctionCache):
    """Cache of what `WholeCompiler` gives."""

    _impl_class = _WholeFiles


class _PartCache(FunctionCache):
    """Cache of what `PartCompiler` gives for a kernel."""

    _impl_class = _PartFiles

    def __init__(self, kernel: Any) -> None:
        super().__init__(kernel.__wrapped__)
        self._kernel = kernel

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is cached for a signature, or None."""
        result = super().load_overload(sig, target_context)
        if result is None or not result.library.complete:
            return None
        result.library.origin = (self._kernel, result.signature)
        return result

    def save_overload(self, sig: Any, result: Any) -> None:
        """Cache what is compiled for a signature."""
        result.library.origin = (self._kernel, result.signature)
        super().save_overload(sig, result)


def whole(kernel: Any, options: Mapping[str, Any]) -> Any:
    """Return the dispatcher of a kernel for calls from Python.

    Args:
        kernel: The kernel.
        options: Options of `numba.njit`.
    """
    dispatcher: Any = njit(pipeline_class=WholeCompiler, **options)(kernel.__wrapped__)
    with suppress(RuntimeError):  # no folder can be written
        dispatcher._cache = _WholeCache(kernel.__wrapped__)
    return dispatcher


def part(kernel: Any, options: Mapping[str, Any]) -> Any:
    """Return the dispatcher of a kernel for calls from other kernels; see `whole`."""
    dispatcher: Any = njit(pipeline_class=PartCompiler, **options)(kernel.__wrapped__)
    with suppress(RuntimeError):
        dispatcher._cache = _PartCache(kernel)
    return dispatcher
