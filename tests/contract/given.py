"""What the test kit gives to a plugin, as a line of text for each call."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from safe_inspect.plugins import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.state import State
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.view import Group, Step, View
from safe_inspect.simulators.world import World

_OF_STEPS = ("action", "control", "desired_control", "intervening", "status", "fired", "has", "dt")


class Calls:
    """Collects the calls of a plugin."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def spied(self, function: Callable[..., Any], name: str = "") -> Callable[..., Any]:
        """Return a method that notes what it is given and returns what a function does."""

        def method(own: Any, *given: Any) -> Any:
            self.note(name, *given)
            return function(*given)

        return method

    def note(self, name: str, *given: Any) -> None:
        """Note a call."""
        self._lines.append(f"{name}({', '.join(map(shown, given))})")

    def text(self) -> str:
        """Return a line for each run of equal calls."""
        runs = ((line, len(list(group))) for line, group in itertools.groupby(self._lines))
        return "\n".join(f"{count} x {line}" for line, count in runs)


def shown(value: Any) -> str:
    """Return shape, mean and root mean square of arrays, and the same of what an object consists of."""
    if isinstance(value, np.ndarray):
        return f"{value.shape} {_short(value.mean() if value.size else 0.0)} {_short(_root_mean_square(value))}"
    if isinstance(value, Streams):
        return f"streams {shown(value.uniform('sample', 2))}"
    if isinstance(value, State):
        sizes = [_root_mean_square(array) for name, array in value.arrays.items() if name != "key"]
        return f"{len(sizes)} arrays {_short(sum(np.log1p(1e3 * size) for size in sizes))}"
    if isinstance(value, View | TeamView):
        return f"view of {shown(value.state)}"
    if isinstance(value, Step | TeamStep):
        own = " ".join(f"{name} {shown(getattr(value, name))}" for name in _OF_STEPS if hasattr(value, name))
        return f"step from {shown(value.before)} to {shown(value.after)} {own}"
    if isinstance(value, bool | str | int) or value is None:
        return repr(value)
    if isinstance(value, float | np.number):
        return _short(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {shown(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(shown, value)) + "]"
    if is_dataclass(value) and not isinstance(value, World | Group | Plugin):
        names = [field.name for field in fields(value) if field.name != "seconds"]  # the computing time
        own = ", ".join(f"{name}={shown(getattr(value, name))}" for name in names)
        return f"{type(value).__name__}({own})"
    return type(value).__name__


def _root_mean_square(array: Any) -> float:
    numbers = np.asarray(array, dtype=np.float64)
    return float(np.sqrt(np.mean(np.square(numbers[np.isfinite(numbers)])))) if np.isfinite(numbers).any() else 0.0


def _short(number: Any) -> str:
    """Return a number with five digits; what may come of rounding alone is 0."""
    return f"{float(number):.5g}" if abs(number) > 1e-9 else "0"
