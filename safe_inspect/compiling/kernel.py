"""`njit` of this package: Numba's, typed, loaded at the first call, with a disk cache that cannot be out of date.

A decorated function is a `Kernel`. Importing its module does not load the compiler, so that a configuration is
validated without it.

Numba recompiles a cached function if its file has changed, but not if a compiled function that it calls from another
file has changed: after an update of a checkout, outdated machine code would continue to run. Therefore machine code is
stored in a folder whose name is a digest of all sources of the package that define kernels or are imported by these.
The machine code of a kernel outside the package, such as a plugin's, is in a subfolder. Its name is a digest of the
other files outside the package with functions that the kernel calls, and of the values that all these functions name:
Numba compiles such values in, and does not notice when they change.

A compiled function must return None, a number, one array, or a tuple of numbers to Python; other results are
written into arrays that are passed to it. Ctrl-C during a call is handled as soon as Python code runs again. To return
a NamedTuple or a tuple of arrays, Numba runs Python code without a check for KeyboardInterrupt, and the process would
end with a segmentation fault or a SystemError.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import importlib.util
import inspect
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar, overload

from safe_inspect.compiling.folders import PACKAGE, digest_of, digest_of_files, installed_folder, machine_code_folder
from safe_inspect.compiling.values import called_by, digest_of_values

#: Options of ``@njit`` for functions that neither create nor return arrays. They do not count references to the arrays
#: that are passed to them, because their caller holds references; otherwise Numba changes a counter, atomically, for
#: each array of a tuple. Numba does not document ``_nrt``. Without it the safety filter takes 1.2 times as long for a
#: state, in the slowest percent of states 2.7 times (`benchmarks/filter_latency.py`), and a sixth longer to compile.
BORROWING: dict[str, Any] = {"error_model": "numpy", "_nrt": False}

P = ParamSpec("P")
R = TypeVar("R")

_choosing = threading.RLock()
#: Compilation time after which a message is printed on a terminal [s].
_PATIENCE = 2.0
_spent = [0.0]
_announced = [False]
#: Environment variable with the path of a file that exists while a process compiles, and afterwards if it took longer
#: than that. A training sets it for Ray's processes, whose output is not visible.
COMPILING_NOTE = "SAFE_INSPECT_COMPILING_NOTE"


class Kernel(Generic[P, R]):
    """A function that Numba compiles at its first call. Kernels can call each other like functions.

    Args:
        function: The function.
        options: Options of `numba.njit`.
        origin: The arguments of `generate` from which the function was made, if it was.
    """

    __wrapped__: Callable[P, R]
    __qualname__: str

    def __init__(
        self, function: Callable[P, R], options: Mapping[str, Any], origin: tuple[Any, ...] | None = None
    ) -> None:  # fmt: skip
        functools.update_wrapper(self, function)
        self._function, self._options, self.origin = function, options, origin

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the compiled function."""
        result: R = self.dispatcher(*args, **kwargs)
        return result

    def __reduce__(self) -> Any:
        """Pickle the kernel by its name in its module, or what it is made from if other processes lack the module."""
        if self.origin is not None:
            return generate, self.origin
        name: str = self._function.__qualname__
        if "<locals>" in name or self._function.__module__ == "__main__":
            return Kernel, (self._function, self._options)
        return name

    def __deepcopy__(self, memo: Any) -> Kernel[P, R]:
        """Return the kernel itself, because it is immutable."""
        return self

    @functools.cached_property
    def dispatcher(self) -> Any:
        """Numba's dispatcher of the function, for calls from Python."""
        return self._compiled({"no_cfunc_wrapper": True})

    @functools.cached_property
    def part(self) -> Any:
        """Numba's dispatcher of the function, for calls from other kernels: without wrappers for Python and C."""
        return self._compiled({"no_cfunc_wrapper": True, "no_cpython_wrapper": True}, "called")

    def _compiled(self, wrappers: Mapping[str, bool], use: str = "") -> Any:
        import numba

        options = {**self._options, **wrappers}
        return cached(lambda function, cache: numba.njit(cache=cache, **options)(function), self, use)


@overload
def njit(function: Callable[P, R], /) -> Kernel[P, R]: ...
@overload
def njit(**options: Any) -> Callable[[Callable[P, R]], Kernel[P, R]]: ...
def njit(function: Any = None, /, **options: Any) -> Any:
    """Return a function as a `Kernel`, cached on disk.

    Args:
        function: The function, if the decorator has no options.
        options: Options of `numba.njit`.
    """
    if function is not None:
        return Kernel(function, {})
    options.pop("cache", None)
    return lambda decorated: Kernel(decorated, options)


def announce_compiling() -> None:
    """Print the message about the compilation also if standard error is not a terminal, as commands do."""
    _announced[0] = True


def compiling_seconds() -> float:
    """Return the total time that this process has waited for the compiler [s]."""
    return _spent[0]


@functools.cache
def prepare() -> None:
    """Load Numba, register the type `Kernel` with it, and start to measure the compilation time; done only once."""
    from numba.core import event  # public: https://numba.readthedocs.io/en/stable/developer/event_api.html
    from numba.extending import typeof_impl

    @typeof_impl.register(Kernel)  # type: ignore[untyped-decorator]
    def _type_of(kernel: Kernel[..., Any], context: Any) -> Any:
        return typeof_impl(kernel.part, context)

    class Announcer(event.Listener):  # type: ignore[misc]
        """Listener that measures the compilation time and prints one message about it."""

        depth, since, told = 0, 0.0, False
        collects, note = False, os.environ.get(COMPILING_NOTE)

        def on_start(self, event: Any) -> None:
            if self.depth == 0:
                self.since, self.collects = time.monotonic(), gc.isenabled()
                gc.disable()  # compilation creates little garbage but many objects
                self._mark(True)
            self.depth += 1

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.depth == 0:
                if self.collects:
                    gc.enable()
                _spent[0] += time.monotonic() - self.since
                self._mark(_spent[0] > _PATIENCE)
            wanted = sys.stderr.isatty() or (_announced[0] and sys.stderr is sys.__stderr__)
            if wanted and not self.told and _spent[0] > _PATIENCE:
                self.told = True
                print("compiling, once for each installation: up to a minute ...", file=sys.stderr)

        def _mark(self, compiling: bool) -> None:
            if self.note:
                with suppress(OSError):
                    Path(self.note).touch() if compiling else Path(self.note).unlink(missing_ok=True)

    event.register("numba:compile", Announcer())  # type: ignore[no-untyped-call]


def cached(compiler: Any, kernel: Kernel[..., Any], use: str = "") -> Any:
    """Return the result of a Numba decorator on a kernel's function, with its machine code cached if possible.

    Args:
        compiler: Function that applies the decorator, called with the function and the option ``cache``.
        kernel: The kernel.
        use: Folder for machine code that differs between uses of the same function; empty if it does not.
    """
    prepare()
    config, function = _config(), kernel.__wrapped__
    before = config.CACHE_DIR
    folder = _folder_for(kernel)
    if folder is None or not Path(inspect.getfile(function)).exists():
        return compiler(function, cache=False)
    with _choosing:
        try:
            config.CACHE_DIR = str(folder / use)  # Numba reads it when a function is decorated
            return compiler(function, cache=True)
        finally:
            config.CACHE_DIR = before


def kept_in() -> Path | None:
    """Return the folder for machine code, or None if none can be written."""
    prepare()
    return machine_code_folder(digest_of(), _given_folder())


def _source_of(function: Callable[..., Any]) -> str:
    """Return the file that defines a function."""
    return inspect.getsourcefile(function) or ""


def _config() -> Any:
    """Return the settings of Numba."""
    import numba

    return numba.config


@functools.cache
def _given_folder() -> str:
    """Return the folder that the user has set for machine code; empty if there is none."""
    return str(_config().CACHE_DIR)


def _folder_for(kernel: Kernel[..., Any]) -> Path | None:
    """Return the folder for the machine code of a kernel, or None if none can be written."""
    folder = kept_in()
    if folder is None or _in_package(_source_of(kernel.__wrapped__)):
        return folder
    own, functions = _source_of(kernel.__wrapped__), _outside([kernel])
    others = {_source_of(function) for function in functions} - {own}  # Numba checks its own file itself
    return folder / hashlib.sha256((digest_of_files(others) + digest_of_values(functions)).encode()).hexdigest()[:16]


def _outside(kernels: Iterable[Kernel[..., Any]]) -> list[Callable[..., Any]]:
    """Return those functions outside the package that are kernels, or called by them, directly or indirectly."""
    functions = called_by(kernel.__wrapped__ for kernel in kernels)
    return [function for function in functions if not _in_package(_source_of(function))]


def _in_package(source: str) -> bool:
    return Path(source).is_relative_to(PACKAGE) and "__pycache__" not in source


_functions: dict[str, Kernel[..., Any]] = {}


def generate(
    name: str, source: str, kernels: Mapping[str, Kernel[..., Any]], options: Mapping[str, Any] | None = None
) -> Kernel[..., Any]:
    """Return a function with generated source as a `Kernel`; the same source and kernels give the same object.

    The source is written to a file, so that the machine code can be cached on disk. The name of the file contains a
    digest of the source, of every file that defines one of the kernels, or a kernel that these call, and of the values
    that kernels outside the package name, so that the cache cannot be out of date. A copy in another process is
    generated again.

    Args:
        name: Name of the function that the source defines.
        source: The source.
        kernels: The kernels that the source calls, by their names in the source.
        options: Options of `numba.njit`.
    """
    digest = hashlib.sha256(repr((sys.version_info[:2], name, sorted((options or {}).items()), source)).encode())
    for label, kernel in sorted(kernels.items()):
        digest.update(f"{label} {kernel.__module__} {kernel.__qualname__}".encode())
    called = called_by(kernel.__wrapped__ for kernel in kernels.values())
    digest.update(digest_of_files(map(_source_of, called)).encode())
    digest.update(digest_of_values(_outside(kernels.values())).encode())
    key = digest.hexdigest()[:24]
    if key not in _functions:
        path = _written(f"{name}_{key}.py", source)
        spec = importlib.util.spec_from_file_location(f"safe_inspect.compiling.kernel.{path.stem}", path)
        assert spec is not None, "a file with the suffix .py has a loader"
        assert spec.loader is not None, "a file with the suffix .py has a loader"
        module = importlib.util.module_from_spec(spec)
        vars(module).update(kernels)
        sys.modules[spec.name] = module  # cached machine code imports its module
        spec.loader.exec_module(module)
        given = options or {}
        _functions[key] = Kernel(getattr(module, name), given, (name, source, kernels, given))
    return _functions[key]


def _written(name: str, source: str) -> Path:
    """Return a file with the source: with the package's machine code, or in a folder for temporary files."""
    own = f"safe_inspect-{os.getuid() if hasattr(os, 'getuid') else 0}"
    chosen = machine_code_folder(digest_of())
    folders = [installed_folder(digest_of()), *([chosen] if chosen else []), Path(tempfile.gettempdir()) / own]
    for folder in folders:
        path = folder / "generated" / name
        try:
            if not path.is_file():
                path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                partial = path.with_suffix(f".{os.getpid()}")
                partial.write_text(source, encoding="utf-8")
                partial.replace(path)
            return path
        except OSError:
            continue
    raise OSError(f"neither {folders[0]} nor {tempfile.gettempdir()} can be written; compiled code needs one of them")
