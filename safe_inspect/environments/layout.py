"""The layout of an agent's actions and observations: names, units and bounds of every element."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.config.spec import AgentSpec
from safe_inspect.glues.base import Glue
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class Layout:
    """The elements of an action or an observation.

    Attributes:
        names: Name of each element.
        low: Smallest value of each, shape (size,).
        high: Largest value of each, shape (size,).
    """

    names: tuple[str, ...]
    low: FloatArray
    high: FloatArray

    @property
    def size(self) -> int:
        """Number of elements."""
        return len(self.names)

    def __str__(self) -> str:
        width = max(map(len, self.names), default=0)
        rows = zip(self.names, self.low, self.high, strict=True)
        return "\n".join(f"  {name:<{width}}  [{low:g}, {high:g}]" for name, low, high in rows)


def observation_layout(agent: AgentSpec) -> Layout:
    """Return the layout of an agent's observation."""
    return _layout(agent, agent.observation_glues)


def action_layout(agent: AgentSpec) -> Layout:
    """Return the layout of an agent's action."""
    return _layout(agent, agent.action_glues)


def _layout(agent: AgentSpec, glues: Sequence[Glue]) -> Layout:
    names = tuple(name for glue in glues for name in glue.names(agent.parts))
    bounds = [glue.bounds(agent.parts) for glue in glues]
    low, high = (np.concatenate([np.empty(0), *(bound[side] for bound in bounds)]) for side in (0, 1))
    return Layout(names, low, high)
