"""`Layout`: names, units and bounds of all elements of an agent's actions and observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from safe_inspect.config.spec import AgentSpec
from safe_inspect.glues.actions import CoastGlue
from safe_inspect.glues.base import Glue
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class Layout:
    """The elements of an action or an observation.

    Attributes:
        names: Name of each element.
        low: Lower bound of each element, shape (size,).
        high: Upper bound of each element, shape (size,).
        choices: For a discrete action, the number of values of each element; the values are the indices 0, 1, ... Empty
            if all elements are real numbers.
        coast: For an action that sets for how many control steps it holds, the glue of its last element.
    """

    names: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    choices: tuple[int, ...] = ()
    coast: CoastGlue | None = None

    @property
    def size(self) -> int:
        """Number of elements."""
        return len(self.names)

    @cached_property
    def last_choices(self) -> FloatArray:
        """For a discrete action, the largest index of each element, shape (size,)."""
        return np.array(self.choices, dtype=np.float64) - 1.0

    def draw(self, generator: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
        """Draw actions uniformly, shape (*shape, size)."""
        shape = (*shape, self.size)
        if self.choices:
            return generator.integers(0, self.choices, shape).astype(np.float64)
        return generator.uniform(self.low, self.high, shape)

    def __str__(self) -> str:
        width = max(map(len, self.names), default=0)
        rows = zip(self.names, self.low, self.high, self.choices or (0,) * self.size, strict=True)
        return "\n".join(
            f"  {name:<{width}}  " + (f"one of {count}" if count else f"[{low:g}, {high:g}]")
            for name, low, high, count in rows
        )


def observation_layout(agent: AgentSpec) -> Layout:
    """Return the layout of an agent's observation."""
    return _layout(agent, agent.observation_glues)


def action_layout(agent: AgentSpec) -> Layout:
    """Return the layout of an agent's action."""
    layout = _layout(agent, agent.action_glues)
    leaves = [leaf for glue in agent.action_glues for leaf in glue.leaves()]
    choices = tuple(count for leaf in leaves for count in leaf.choices(agent.parts))
    coast = next((leaf for leaf in leaves if isinstance(leaf, CoastGlue)), None)
    return replace(layout, choices=choices if all(choices) else (), coast=coast)


def _layout(agent: AgentSpec, glues: Sequence[Glue]) -> Layout:
    names = tuple(name for glue in glues for name in glue.names(agent.parts))
    bounds = [glue.bounds(agent.parts) for glue in glues]
    low, high = (np.concatenate([np.empty(0), *(bound[side] for bound in bounds)]) for side in (0, 1))
    return Layout(names, low, high)
