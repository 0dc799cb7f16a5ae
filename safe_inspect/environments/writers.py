"""Name the plugin that writes into an array that it is given."""

from __future__ import annotations

import functools
import linecache
import traceback
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from safe_inspect.errors import PluginValueError
from safe_inspect.plugins.plugin import Plugin

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")


def writes_read_only(error: BaseException) -> bool:
    """Return whether an exception is NumPy's refusal to write into a read-only array."""
    return isinstance(error, ValueError) and "read-only" in str(error)


def names_writers(function: Callable[_Given, _Result]) -> Callable[_Given, _Result]:
    """Wrap a function that calls plugins, so that one that writes into what it is given is named.

    Raises:
        PluginValueError: A plugin does.
    """

    @functools.wraps(function)
    def wrapped(*args: _Given.args, **kwargs: _Given.kwargs) -> _Result:
        try:
            return function(*args, **kwargs)
        except ValueError as error:
            message = _message(error) if writes_read_only(error) else ""
            if not message:
                raise
            raise PluginValueError(message) from error

    return wrapped


def _message(error: ValueError) -> str:
    """Name the innermost plugin among the calls that led to an exception, and its line; empty without one."""
    frames = [(frame.f_locals.get("self"), frame, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    calls = [(plugin, frame, line) for plugin, frame, line in frames if isinstance(plugin, Plugin)]
    if not calls:
        return ""
    plugin, frame, line = calls[-1]
    file = frame.f_code.co_filename
    return (
        f"the {plugin.kind} {plugin.registered_name} writes into an array that is read-only "
        f"({file}:{line}: {linecache.getline(file, line).strip()}); compute on a copy, or remember in a declared array"
    )
