"""Data that are constant while N environments run: names, sizes and constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from safe_inspect.simulators.offers import Offers, missing
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class World:
    """The constants of a simulation, and by name what its dynamics and components provide, such as ``mean_motion``.

    Attributes:
        platforms: Names of the deputies, in agent order.
        bodies: Index of every body by name, the deputies first.
        masses: Mass of each deputy [kg], shape (D,).
        step_size: Length of a step [s].
        offers: Values that dynamics and components provide.
    """

    platforms: tuple[str, ...]
    bodies: Mapping[str, int]
    masses: FloatArray
    step_size: float
    offers: Offers = field(default_factory=Offers)

    def __getattr__(self, name: str) -> Any:
        """Return a value that the dynamics or a component provides."""
        offers = self.__dict__.get("offers")
        if offers is None or name not in offers.world:
            raise missing("world", name, {} if offers is None else offers.world)
        return offers.world[name]

    @property
    def num_deputies(self) -> int:
        """Number of deputies, D."""
        return len(self.platforms)
