"""Name the plugin that fails, or writes into an array that it is given."""

from __future__ import annotations

import functools
import linecache
import traceback
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from safe_inspect.errors import MissingNameError, PluginValueError, SafeInspectError
from safe_inspect.interrupts import Interrupted
from safe_inspect.plugins.plugin import Plugin

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")

_RAISE = "raise an error that says what is wrong, or return a value"
#: What a plugin does that raises these, and what to do instead.
_ENDS: dict[type[BaseException], tuple[str, str]] = {
    SystemExit: ("ends the program", _RAISE),
    GeneratorExit: ("raises GeneratorExit", _RAISE),
    RecursionError: ("calls itself without end", "its traceback is left out; mend the call"),
}


def writes_read_only(error: BaseException) -> bool:
    """Return whether an exception is NumPy's refusal to write into a read-only array."""
    return isinstance(error, ValueError) and "read-only" in str(error)


def names_writers(function: Callable[_Given, _Result]) -> Callable[_Given, _Result]:
    """Wrap a function that calls plugins, so that one that writes into what it is given, or fails, is named.

    One that reads what the task does not offer is named too. Other exceptions than the package's own get a note.

    Raises:
        MissingNameError: A plugin reads what the task does not offer.
        PluginValueError: A plugin writes into a read-only array, ends the program, or calls itself without end.
    """

    @functools.wraps(function)
    def wrapped(*args: _Given.args, **kwargs: _Given.kwargs) -> _Result:
        try:
            return function(*args, **kwargs)
        except SafeInspectError as error:
            plugin = _innermost(error)[0] if isinstance(error, MissingNameError) and error.name else None
            if plugin is None:
                raise
            raise MissingNameError(f"the {plugin.kind} {plugin.registered_name} does not fit: {error}") from error
        except BaseException as error:
            if isinstance(error, Interrupted):  # of a signal, wherever that arrives
                raise
            plugin, file, line = _innermost(error)
            if plugin is None:
                raise
            what = f"the {plugin.kind} {plugin.registered_name}"
            if writes_read_only(error):
                source = linecache.getline(file, line).strip()
                raise PluginValueError(
                    f"{what} writes into an array that is read-only ({file}:{line}: {source}); compute on a copy, or "
                    "remember in a declared array"
                ) from error
            ends = _ENDS.get(type(error))
            if ends is not None:
                source = linecache.getline(file, line).strip()
                raise PluginValueError(f"{what} {ends[0]} ({file}:{line}: {source}); {ends[1]}") from None
            error.add_note(f"raised in {what} ({file}:{line})")
            raise

    return wrapped


def _innermost(error: BaseException) -> tuple[Plugin | None, str, int]:
    """Return the innermost plugin among the calls that led to an exception, and its line; None without one."""
    frames = [(frame.f_locals.get("self"), frame, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    calls = [(plugin, frame, line) for plugin, frame, line in frames if isinstance(plugin, Plugin)]
    if not calls:
        return None, "", 0
    plugin, frame, line = calls[-1]
    return plugin, frame.f_code.co_filename, line
