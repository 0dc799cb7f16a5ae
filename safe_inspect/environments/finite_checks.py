"""Checks for NaN, infinity and wrong shapes, and errors that name the plugin."""

from __future__ import annotations

import functools
import linecache
import operator
import os
import tempfile
import traceback
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from safe_inspect.errors import RAISED_IN, MissingNameError, PluginValueError, SafeInspectError
from safe_inspect.interrupts import Interrupted
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators import State
from safe_inspect.types import AnyArray

#: Environment variable with the folder for states that caused an error; during training it is the run folder.
CRASH_FOLDER_VARIABLE = "SAFE_INSPECT_CRASH_FOLDER"


def checked_seed(seed: int) -> int:
    """Return a seed as an int.

    Raises:
        TypeError: The seed is not a whole number.
        ValueError: The seed is out of range.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        raise TypeError(f"a seed must be a whole number from 0 to 2**64 - 1, not {seed!r}") from None
    if not 0 <= number < 2**64:
        raise ValueError(f"a seed must be a whole number from 0 to 2**64 - 1, not {number}")
    return number


def require_shape(what: str, value: AnyArray, shape: tuple[int, ...]) -> None:
    """Raise an error when a plugin returned an array of the wrong shape.

    Raises:
        PluginValueError: The array does not have the expected shape.
    """
    if value.shape != shape:
        meant = "one entry for each row of the batch"
        if not value.shape:
            meant += "; sums and norms of a row need `axis=-1`"
        raise PluginValueError(f"{what} gave an array of shape {value.shape}; expected shape {shape}, {meant}")


def all_finite(value: AnyArray) -> bool:
    """Return whether all elements are finite. Counting is much faster than `all` on a small array."""
    return bool(np.count_nonzero(np.isfinite(value)) == value.size)


def require_finite(what: str, value: AnyArray, after: State, before: State | None = None) -> None:
    """Raise an error when an array contains NaN or infinity.

    The states of the rows in question are saved as ``.npz`` files in the folder given by the environment variable
    ``SAFE_INSPECT_CRASH_FOLDER``, or else in a new temporary folder.

    Args:
        what: Source of the array, such as ``reward ObservedPointsReward``.
        value: The array; its first axis has one or more rows for each environment.
        after: State at the end of the step.
        before: State at the start of the step, if there is one.

    Raises:
        PluginValueError: The array is not finite.
    """
    if all_finite(value):
        return
    finite = np.isfinite(value)
    bad = np.flatnonzero(~finite.reshape(len(value), -1).all(axis=-1))
    rows = np.unique(bad * after.num_envs // len(value))
    folder = os.environ.get(CRASH_FOLDER_VARIABLE) or tempfile.mkdtemp(prefix="safe_inspect_")
    os.makedirs(folder, exist_ok=True)
    saved = []
    for name, state in (("before", before), ("after", after)):
        if state is not None:
            path = os.path.join(folder, f"state_{name}_{os.getpid()}.npz")
            state.take(rows).save(path)
            saved.append(path)
    first = rows[0] if after.whole_rows is None else after.whole_rows[rows[0]]
    raise PluginValueError(
        f"{what} gave {value[bad[0]].ravel().tolist()} in environment {first}, step {int(after.step[rows[0]])} "
        f"({len(rows)} of {after.num_envs} environments); the states are saved in {' and '.join(saved)}"
    )


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
