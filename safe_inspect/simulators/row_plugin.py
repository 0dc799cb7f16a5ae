"""Base class of the plugins that can be defined by a row kernel: sensors, rewards and done functions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from safe_inspect.errors import PluginValueError
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.row_loops import PlacedTerm, address_of, place_term
from safe_inspect.simulators.row_terms import Intervening, MemoryBase, RowTerm, Scene, TermReading
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Group, Step, View
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray

_Call = TypeVar("_Call", bound=Callable[..., Any])


def batch_call(function: _Call) -> _Call:
    """Mark the ``__call__`` of a kind of plugins as abstract until a class defines it or `row`.

    Type checkers cannot see that defining `row` is sufficient, so they treat the method as concrete.
    """
    return abstractmethod(function)


class _Known(NamedTuple):
    """A term as last placed for states of one size, with the data for which it was placed."""

    world: World
    group: Group
    specs: Any
    placed: PlacedTerm
    read: tuple[TermReading, ...]
    intervening: bool


class RowPlugin(Plugin):
    """A plugin that may define a row kernel with `row`, from which the call for a batch is derived.

    If a class defines both `row` and ``__call__``, the latter is used when `row` returns None, and must return the same
    result otherwise.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Add the batch call to a class that defines `row` and has no ``__call__``."""
        super().__init_subclass__(**kwargs)
        if "row" in vars(cls) and getattr(cls.__call__, "__isabstractmethod__", False):
            cls.__call__ = RowPlugin.call_rows  # type: ignore[method-assign]

    def row(self, world: World, group: Group) -> RowTerm | None:
        """Return the row kernel with its inputs; None if the plugin is called with the whole batch instead.

        Args:
            world: The constant data of the simulation.
            group: The agents; the plugin may use their `sensors` as inputs.
        """
        return None

    def call_rows(self, seen: View | Step) -> AnyArray:
        """Return the result of the row kernel for every row, shape (R,), or (R, size) for a sensor.

        Raises:
            PluginValueError: The kernel raised an exception.
        """
        before, view = (seen.before, seen.after) if isinstance(seen, Step) else (seen, seen)
        state, group = view.writable, view.group
        by_size: dict[int, _Known] = self.__dict__.setdefault("_known_rows", {})
        known = by_size.get(state.num_envs)
        if known is None or known.world is not view.world or known.group is not group or known.specs is not state.specs:
            known = by_size[state.num_envs] = self._place(view.world, group, state)
        given: list[AnyArray | None] = [None, state.floats, before.writable.floats, None, None, None]
        if known.read:
            readings = [reading.read(view) for reading in known.read]
            given[MemoryBase.READINGS] = np.concatenate(readings, axis=1, dtype=np.float64)
        if known.intervening and isinstance(seen, Step):
            given[MemoryBase.INTERVENING] = np.ascontiguousarray(seen.writable_intervening)
        dtype, size = self.row_result()
        out = np.full((view.num_rows, size), np.nan) if size else np.empty(view.num_rows, dtype=dtype)
        bases = np.array([0 if array is None else address_of(array) for array in given], dtype=np.int64)
        placed, places = known.placed, (address_of(bases), address_of(out))
        if not placed.call(placed.table_address, *places, state.num_envs, group.size):
            raise PluginValueError(
                f"the row kernel of {self.kind} {self.registered_name} raised an exception, which is printed above"
            )
        return out

    def row_result(self) -> tuple[type[Any], int]:
        """Return the type of the result's elements, and their number if the kernel writes them, else 0."""
        return np.float64, 0

    def _place(self, world: World, group: Group, state: State) -> _Known:
        term = self.row(world, group)
        if term is None:
            raise TypeError(f"{type(self).__name__} defines no row kernel; define `row` or `__call__`")
        columns, width = {}, 0
        for reading in term.read:
            size = reading.size_of(group)
            columns[reading.key] = slice(width, width + size)
            width += size
        dtype, size = self.row_result()
        scene = Scene(world, group, state, columns, width)
        placed = place_term(term, scene, dtype, np.dtype(dtype).itemsize * max(size, 1), size)
        intervening = any(isinstance(given, Intervening) for given in term.inputs)
        return _Known(world, group, state.specs, placed, term.read, intervening)
