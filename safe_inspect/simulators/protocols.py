"""Protocols for the parts of an agent that the simulation uses; the classes themselves belong to higher layers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from safe_inspect.simulators.world import World
from safe_inspect.types import ArraySpec, FloatArray


class DeclaresMemory(Protocol):
    """A safety filter, a scripted policy or a done function, which may declare arrays that are part of the state."""

    def memory(self, world: World, /) -> Mapping[str, ArraySpec]:
        """Declare the arrays in which the part stores data, each with its shape for one agent or one environment."""


class ReadsState(DeclaresMemory, Protocol):
    """A sensor."""

    @property
    def symbol(self) -> str:
        """SI unit of the reading, empty for a pure number."""

    @property
    def size(self) -> int:
        """Number of elements of a reading."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest possible value of a reading, SI."""

    def __call__(self, view: Any, /) -> FloatArray:
        """Return the reading, SI, shape (R, size)."""

    def remember(self, view: Any, name: str, /) -> None:
        """Update the declared arrays in place; called once for every new state."""
