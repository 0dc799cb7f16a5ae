"""`njit` of this package: Numba's, typed, loaded at the first call, with a cache on disk that cannot be out of date.

A decorated function is a `Kernel`. Importing its module loads no compiler: a configuration is validated without one.

Numba recompiles a cached function when its own file has changed, but not when a compiled function that it calls from
another file has: after an update of a checkout old machine code would go on running. So the cached machine code of the
whole package is removed when the source of any compiled function has changed, and that of kernels elsewhere, such as a
plugin's, is compiled again.

What Python calls is compiled together with all that it calls; see `safe_inspect.compiling.linking`.

What a compiled function returns to Python is None, a number, one array, or a tuple of numbers; other results are
written into arrays that it is given. Ctrl-C during a call is handled as soon as Python code runs again, and Numba runs
some to return a NamedTuple or a tuple of arrays, without a check for KeyboardInterrupt: the process would end with a
segmentation fault or a SystemError.
"""

from __future__ import annotations

import functools
import gc
import os
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar, overload

from safe_inspect.compiling.folders import PACKAGE, digest_of

__all__ = ["BORROWING", "Kernel", "njit"]

#: Options of ``@njit`` for functions that make and return no array. They count no references to the arrays that they
#: are given, for their caller holds them; else Numba changes a counter, atomically, for each array of a tuple.
BORROWING: dict[str, Any] = {"error_model": "numpy", "_nrt": False}

P = ParamSpec("P")
R = TypeVar("R")

_STAMP = "compiled.stamp"
#: Seconds of compiling after which a terminal is told what the wait is for.
_PATIENCE = 2.0
_spent = [0.0]
#: Environment variable: a file that exists while a process compiles, and after that where it took longer than that. A
#: training gives it to Ray's processes, whose output nobody sees.
COMPILING_NOTE = "SAFE_INSPECT_COMPILING_NOTE"


class Kernel(Generic[P, R]):
    """A function that Numba compiles at its first call. Kernels call each other like functions.

    Args:
        function: The function.
        options: Options of `numba.njit`.
    """

    __wrapped__: Callable[P, R]
    __qualname__: str

    def __init__(self, function: Callable[P, R], options: Mapping[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options = function, options
        self._dispatcher: Callable[P, R] | None = None
        self._part: Any = None

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the compiled function."""
        call = self._dispatcher or self.dispatcher
        return call(*args, **kwargs)

    def __reduce__(self) -> Any:
        """Pickle the kernel as what its module calls it, or as its function where another process lacks the module."""
        name: str = self._function.__qualname__
        if "<locals>" in name or self._function.__module__ == "__main__":
            return Kernel, (self._function, self._options)
        return name

    def __deepcopy__(self, memo: Any) -> Kernel[P, R]:
        """Return the kernel itself: it does not change."""
        return self

    @property
    def dispatcher(self) -> Any:
        """Numba's dispatcher of the function, for calls from Python."""
        if self._dispatcher is None:
            self._dispatcher = _dispatchers().whole(self, self._options)
        return self._dispatcher

    @property
    def part(self) -> Any:
        """Numba's dispatcher of the function, for calls from other kernels."""
        if self._part is None:
            self._part = _dispatchers().part(self, self._options)
        return self._part


@overload
def njit(function: Callable[P, R], /) -> Kernel[P, R]: ...
@overload
def njit(**options: Any) -> Callable[[Callable[P, R]], Kernel[P, R]]: ...
def njit(function: Any = None, /, **options: Any) -> Any:
    """Return a function as a `Kernel`, cached on disk.

    Args:
        function: The function, where the decorator has no options.
        options: Options of `numba.njit`.
    """
    if function is not None:
        return Kernel(function, {})
    options.pop("cache", None)
    return lambda decorated: Kernel(decorated, options)


def compiling_seconds() -> float:
    """Return how long this process has waited for the compiler [s]."""
    return _spent[0]


def _dispatchers() -> Any:
    """Return the module that makes dispatchers, which loads Numba."""
    prepare()
    return import_module("safe_inspect.compiling.dispatchers")


@functools.cache
def prepare() -> None:
    """Load Numba, teach it what a `Kernel` is, and remove machine code that is out of date; done once."""
    remove_stale_cache()
    from numba.core import event
    from numba.extending import typeof_impl

    @typeof_impl.register(Kernel)  # type: ignore[untyped-decorator]
    def _type_of(kernel: Kernel[..., Any], context: Any) -> Any:
        return typeof_impl(kernel.part, context)

    class Announcer(event.Listener):  # type: ignore[misc]
        """Measures the time of the compiler, and says once, on a terminal, that the wait is for it."""

        depth, since, quiet = 0, 0.0, not sys.stderr.isatty()
        collects, note = False, os.environ.get(COMPILING_NOTE)

        def on_start(self, event: Any) -> None:
            if self.depth == 0:
                self.since, self.collects = time.monotonic(), gc.isenabled()
                gc.disable()  # compiling leaves little garbage, and much to look through
                self._mark(True)
            self.depth += 1

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.depth == 0:
                if self.collects:
                    gc.enable()
                _spent[0] += time.monotonic() - self.since
                self._mark(_spent[0] > _PATIENCE)
            if not self.quiet and _spent[0] > _PATIENCE:
                self.quiet = True
                print("compiling, once for each installation: up to a minute ...", file=sys.stderr)

        def _mark(self, compiling: bool) -> None:
            if self.note:
                with suppress(OSError):
                    Path(self.note).touch() if compiling else Path(self.note).unlink(missing_ok=True)

    event.register("numba:compile", Announcer())  # type: ignore[no-untyped-call]


def remove_stale_cache(package: Path = PACKAGE) -> bool:
    """Remove the cached machine code below a folder unless it belongs to the present sources.

    Args:
        package: The folder of a package.

    Returns:
        Whether the cache was out of date. A folder that cannot be written is left alone: the machine code is then
        kept in a folder of the user's, one for each state of the sources.
    """
    digest = digest_of.__wrapped__(package)  # of the files as they are now
    stamp = package / "__pycache__" / _STAMP
    try:
        if stamp.is_file() and stamp.read_text(encoding="ascii") == digest:
            return False
        for pattern in ("*.nbi", "*.nbc"):
            for path in package.rglob(f"__pycache__/{pattern}"):
                path.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest, encoding="ascii")
    except OSError:
        return False
    return True
