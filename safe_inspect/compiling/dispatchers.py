# mypy: disable-error-code="attr-defined,misc,no-untyped-call,valid-type"
"""Dispatchers of kernels, with what is compiled kept on disk.

This file belongs to the sources of compiled functions (those with ``@njit``): a change of it removes what is cached.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.compiler import compile_result

from safe_inspect.compiling.folders import digest_of, user_folder
from safe_inspect.compiling.linking import PartCompiler, PartLibrary, WholeCompiler
from safe_inspect.compiling.references import handed


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

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return the key of machine code with the digest of the package's kernels, which are linked into it.

        `remove_stale_cache` removes what is out of date in the package alone, not beside a user's kernels.
        """
        return (*super()._index_key(sig, codegen), digest_of())


class _PartCache(_WholeCache):
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
    fold = dispatcher._compiler.fold_argument_types

    def fold_argument_types(args: Any, kws: Any) -> tuple[Any, tuple[Any, ...]]:
        signature, folded = fold(args, kws)
        return signature, tuple(map(handed, folded))

    dispatcher._compiler.fold_argument_types = fold_argument_types
    with suppress(RuntimeError):
        dispatcher._cache = _PartCache(kernel)
    return dispatcher
