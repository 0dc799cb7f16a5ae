"""`names_writers`, a decorator of functions that call plugins: errors then name the plugin that caused them."""

from __future__ import annotations

import functools
import linecache
import os
import traceback
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from safe_inspect.errors import RAISED_IN, MissingNameError, PluginValueError, SafeInspectError
from safe_inspect.interrupts import Interrupted
from safe_inspect.plugins.plugin import Plugin

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")

_PYDANTIC = f"{os.sep}pydantic{os.sep}"  # a missing attribute of a plugin is looked up there
_RAISE = "raise an error that says what is wrong, or return a value"
#: For each exception, what the plugin that raised it did, and how to fix it.
_ENDS: dict[type[BaseException], tuple[str, str]] = {
    SystemExit: ("ends the program", _RAISE),
    GeneratorExit: ("raises GeneratorExit", _RAISE),
    RecursionError: ("calls itself without end", "its traceback is left out; fix the recursive call"),
}


def writes_read_only(error: BaseException) -> bool:
    """Return whether an exception was raised by NumPy because of a write into a read-only array."""
    return isinstance(error, ValueError) and "read-only" in str(error)


def names_writers(function: Callable[_Given, _Result]) -> Callable[_Given, _Result]:
    """Wrap a function that calls plugins, so that its errors name the plugin that caused them.

    A plugin causes an error if it fails, writes into an array that was passed to it, or reads something that the task
    does not provide. Exceptions of types outside of this package get a note with the plugin's name.

    Raises:
        MissingNameError: A plugin reads something that the task does not provide.
        PluginValueError: A plugin writes into a read-only array, ends the program, or recurses without end.
    """

    @functools.wraps(function)
    def wrapped(*args: _Given.args, **kwargs: _Given.kwargs) -> _Result:
        try:
            return function(*args, **kwargs)
        except BaseException as error:
            reads_missing = isinstance(error, MissingNameError) and bool(error.name)
            if isinstance(error, Interrupted) or (isinstance(error, SafeInspectError) and not reads_missing):
                raise  # a signal handler raises Interrupted at any place
            plugin, file, line = _innermost(error)
            if plugin is None:
                raise
            what, source = f"the {plugin.kind} {plugin.registered_name}", linecache.getline(file, line).strip()
            if reads_missing:
                raise MissingNameError(f"{what} reads a missing value ({file}:{line}): {error}") from error
            if writes_read_only(error):
                raise PluginValueError(
                    f"{what} writes into an array that is read-only ({file}:{line}: {source}); compute on a copy, or "
                    "store the values in a declared array"
                ) from error
            ends = _ENDS.get(type(error))
            if ends is not None:
                raise PluginValueError(f"{what} {ends[0]} ({file}:{line}: {source}); {ends[1]}") from None
            if not any(note.startswith(RAISED_IN) for note in getattr(error, "__notes__", ())):
                error.add_note(f"{RAISED_IN}{what} ({file}:{line})")
            raise

    return wrapped


def _innermost(error: BaseException) -> tuple[Plugin | None, str, int]:
    """Return the innermost plugin in the call stack of an exception, with its file and line; None without a plugin."""
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        plugin = frame.f_locals.get("self")
        if isinstance(plugin, Plugin) and _PYDANTIC not in frame.f_code.co_filename:
            return plugin, frame.f_code.co_filename, line
    return None, "", 0
