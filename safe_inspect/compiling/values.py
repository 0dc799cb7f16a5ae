"""What compiled functions contain besides their own code: the functions that they call and the values that they name.

Numba compiles the value of a global or closed-over name into the machine code, as a constant.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from types import CodeType, ModuleType
from typing import Any

Function = Callable[..., Any]


def compiled_function(value: Any) -> Function | None:
    """Return the Python function of a kernel or of one of Numba's dispatchers, or None for any other value."""
    if hasattr(type(value), "dispatcher"):  # a kernel, whose property would load Numba
        function: Function | None = getattr(value, "__wrapped__", None)
        return function
    return getattr(value, "py_func", None)


def called_by(functions: Iterable[Function]) -> list[Function]:
    """Return functions and all compiled functions that they call, directly or indirectly, in a reproducible order."""
    found: dict[Function, None] = {}
    waiting = list(functions)
    while waiting:
        function = waiting.pop()
        if function not in found:
            found[function] = None
            called = (compiled_function(value) for _, value in _named_in(function))
            waiting += [each for each in called if each is not None]
    return list(found)


def digest_of_values(functions: Iterable[Function]) -> str:
    """Return a digest of the values that functions name, without the compiled functions among them."""
    digest = hashlib.sha256()
    for function in functions:
        for name, value in _named_in(function):
            if compiled_function(value) is None and not isinstance(value, ModuleType):
                digest.update(f"{function.__qualname__} {name} ".encode() + _content(value))
    return digest.hexdigest()


def _named_in(function: Function) -> Iterator[tuple[str, Any]]:
    """Yield the globals and closed-over values that the code of a function names, with the members of modules."""
    names = list(dict.fromkeys(_names(function.__code__)))
    values = {name: function.__globals__[name] for name in names if name in function.__globals__}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        values[name] = cell.cell_contents
    waiting, seen = list(values.items()), set()
    while waiting:
        path, value = waiting.pop()
        yield path, value
        if isinstance(value, ModuleType) and id(value) not in seen:
            seen.add(id(value))
            waiting += [(f"{path}.{name}", getattr(value, name)) for name in names if hasattr(value, name)]


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):  # a comprehension or an inner function
            yield from _names(constant)


def _content(value: Any) -> bytes:
    """Return bytes that are equal for equal values, also in another process, if the type of the value permits it."""
    if isinstance(value, type) and issubclass(value, Enum):
        return repr([(member.name, member.value) for member in value]).encode()
    if callable(value):
        return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', repr(value))}".encode()
    try:
        return pickle.dumps(value, protocol=5)
    except (pickle.PicklingError, TypeError, AttributeError):  # of a type that cannot be pickled
        return repr(value).encode()
