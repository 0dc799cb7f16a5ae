# mypy: disable-error-code="attr-defined,misc,no-untyped-call,valid-type"
"""How kernels are compiled: once for each that Python calls, together with all that it calls.

Numba optimises a compiled function by itself, writes its machine code, and does both again for each function that calls
it, for it is linked into the caller. A kernel that is called by kernels alone needs neither: its intermediate code is
kept, and linked once into each kernel that Python calls (`WholeCompiler`), where all is optimised together.

This file belongs to the sources of compiled functions (those with ``@njit``): a change of it removes what is cached.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable
from typing import Any, ClassVar

from llvmlite import binding
from llvmlite.binding.newpassmanagers import create_new_module_pass_manager
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.environment import lookup_environment
from numba.core.targetconfig import ConfigStack

from safe_inspect.compiling.references import mark, require_value

_ENVIRONMENT = "_ZN08NumbaEnv"
#: How the names of compiled functions begin.
_MANGLED = "_ZN"


class _Unplaced:
    """In place of a code generator: code that is not in memory has no environment to be told."""

    def set_env(self, name: str, env: Any) -> None:
        """Do nothing."""


class _Library(JITCodeLibrary):
    """Code of a kernel, which is optimised when all that it calls is linked."""

    def add_ir_module(self, module: Any) -> None:
        """Add the code of a function."""
        mark(module.functions)
        super().add_ir_module(module)

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout


class PartLibrary(_Library):
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

    def finalize(self) -> None:
        """Keep the code as it is."""
        self._raise_if_finalized()
        passes = create_new_module_pass_manager()
        passes.add_sroa_pass()
        passes.add_instruction_combine_pass()  # takes tuples apart: most of the code puts them together and apart again
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


class WholeLibrary(_Library):
    """Machine code of a kernel that Python calls, with all that it calls."""

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


class _FixedFlags(Flags):
    """Options that nothing changes, one object for those that are equal.

    Numba looks functions up by them tens of thousands of times in a compilation, and the hash of its own is the same
    for all options.
    """

    __slots__ = ()
    _known: ClassVar[list[_FixedFlags]] = []

    def __hash__(self) -> int:
        """Return the hash of the object."""
        return id(self)

    def __eq__(self, other: object) -> bool:
        """Return whether these are the options of another object."""
        return self is other or (not isinstance(other, _FixedFlags) and super().__eq__(other))

    def copy(self) -> Flags:
        """Return options that can be changed."""
        return Flags(self)

    @classmethod
    def of(cls, flags: Flags) -> _FixedFlags:
        """Return the one object of these options."""
        for known in cls._known:
            if known == flags:
                return known
        cls._known.append(cls(flags))
        return cls._known[-1]


class _KernelFlags(Flags):
    """Options of a kernel; a copy, which Numba makes to look functions up, is fixed."""

    __slots__ = ()

    def copy(self) -> Flags:
        """Return the options as they are now."""
        return _FixedFlags.of(self)


@functools.cache
def _remembering(context: Any) -> Any:
    """Return a typing context that remembers what functions give for numbers and arrays, and is else another one.

    Numba tries some ten signatures and templates each time that two numbers are added.
    """
    known: dict[Any, Any] = {}

    class Remembering(type(context)):  # type: ignore[misc]
        def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
            """Return the signature of a function for types of arguments."""
            if kws or not (isinstance(func, types.Function) or func is operator.getitem) or not all(map(_plain, args)):
                return super().resolve_function_type(func, args, kws)
            key = func, tuple(args), ConfigStack.top_or_none()
            if key not in known:
                known[key] = super().resolve_function_type(func, args, kws)
            return known[key]

    remembering = object.__new__(Remembering)
    remembering.__dict__ = context.__dict__
    return remembering


def _plain(given: types.Type) -> bool:
    if isinstance(given, types.BaseTuple):
        return all(_plain(each) for each in given)
    return isinstance(given, types.Number | types.Boolean | types.Literal | types.Array)


class WholeCompiler(Compiler):
    """Compiles kernels that Python calls."""

    _library: type[JITCodeLibrary] = WholeLibrary

    def __init__(
        self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any, locals: Any
    ) -> None:
        flags = _KernelFlags(flags)
        if not flags.no_cpython_wrapper:
            flags.no_cfunc_wrapper = True  # called from Python, or by its address: never both
        super().__init__(_remembering(typingctx), targetctx, library, args, return_type, flags, locals)

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
        result = super()._compile_bytecode()
        require_value(result.signature.return_type, identity.func_qualname)
        return result
