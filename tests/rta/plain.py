"""Kernels as plain Python functions, in which no index leaves its array and no number is read before it is written."""

from __future__ import annotations

import importlib
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from safe_inspect.compiling import Kernel

_made: dict[Kernel[..., Any], Callable[..., Any]] = {}


class Strict(np.ndarray):
    """An array that has no elements counted from its end, as in machine code."""

    def __getitem__(self, key: Any) -> Any:
        _check(key)
        return super().__getitem__(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        _check(key)
        super().__setitem__(key, value)


def _check(key: Any) -> None:
    for index in key if isinstance(key, tuple) else (key,):
        if isinstance(index, int | np.integer) and index < 0:
            raise IndexError(f"{index} is before the beginning of the array")


class _NumPy:
    """NumPy, whose new arrays are strict and full of what nobody should read."""

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    @staticmethod
    def zeros(shape: Any, dtype: Any = np.float64) -> Any:
        return np.zeros(shape, dtype).view(Strict)

    @staticmethod
    def empty(shape: Any, dtype: Any = np.float64) -> Any:
        nobody = np.nan if np.issubdtype(dtype, np.floating) else np.ones((), dtype) * 10**9
        return np.full(shape, nobody, dtype).view(Strict)


def plain(kernel: Any) -> Any:
    """Return a kernel, and the kernels that it calls, as plain Python."""
    if not isinstance(kernel, Kernel):
        return kernel
    if kernel not in _made:
        function: Any = kernel.__wrapped__
        names = dict(function.__globals__)
        _made[kernel] = types.FunctionType(
            function.__code__, names, function.__name__, function.__defaults__, function.__closure__
        )
        for name in function.__code__.co_names:
            names[name] = plain(names[name]) if name in names else None
            if names[name] is None:
                del names[name]
            elif names[name] is np:
                names[name] = _NumPy()
    return _made[kernel]


def strict(value: Any) -> Any:
    """Return an array as a strict one, and a tuple with its arrays as strict ones."""
    if isinstance(value, np.ndarray):
        return value.view(Strict)
    if isinstance(value, tuple):
        parts = [strict(each) for each in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value


class _Rows:
    """A module of compiled rows as plain Python."""

    def __init__(self, name: str) -> None:
        self._module = importlib.import_module(f"safe_inspect.rta.{name}")

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._module, name)
        if not isinstance(found, Kernel):
            return found
        return lambda *arguments: plain(found)(*map(strict, arguments))


@contextmanager
def uncompiled() -> Iterator[None]:
    """Let the filters run their rows as plain Python."""
    with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
        for name in ("backup.safety_filter", "team.safety_filter"):
            patch.setattr(f"safe_inspect.rta.{name}.compiled", _Rows)
        yield
