"""Checks of what a plugin returns, with errors that name the call and the rule."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from safe_inspect.errors import PluginValueError


def called(plugin: object, method: str = "__call__") -> str:
    """Return the name of a method, as messages print it."""
    return f"{type(plugin).__qualname__}.{method}"


def require_type(call: str, value: Any, cls: type) -> None:
    """Raise an error if a call returned an object of another class.

    Raises:
        PluginValueError: The object is not of the class.
    """
    if not isinstance(value, cls):
        raise PluginValueError(f"{call} returned {value!r:.60}; it must return a {cls.__name__}")


def require_arrays(call: str, arrays: Iterable[tuple[str, Any, tuple[int, ...]]]) -> None:
    """Raise an error if a part of what a call returned is not an array of numbers of the right shape.

    Args:
        call: Name of the call.
        arrays: Name, value and shape of each part.

    Raises:
        PluginValueError: A part is something else.
    """
    for name, value, shape in arrays:
        if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype.kind not in "fiu":
            what = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else f"{value!r:.60}"
            raise PluginValueError(f"{call} returned {what} as {name}; it must be an array of numbers, shape {shape}")
