"""Base of the policies that are written, not trained."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import SCRIPTED_POLICY, View
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray

__all__ = ["SCRIPTED_POLICY", "ScriptedPolicy", "ThrustLimits"]


@dataclass(frozen=True)
class ThrustLimits:
    """What the controllers of an agent can give along each axis [N].

    Attributes:
        low: Smallest thrust, shape (3,).
        high: Largest thrust, shape (3,).
    """

    low: FloatArray
    high: FloatArray


class ScriptedPolicy(Plugin):
    """Flies the deputies of a group of agents: called once a step with a `View`, it returns the thrust to hold.

    The thrust is clipped to the controllers' limits and passes the safety filter, as a trained policy's does. A policy
    sees the whole state. What it remembers it declares in `memory` and writes in place, through
    ``view.memory(SCRIPTED_POLICY, array)``, at its call; the arrays are filled anew at every reset.
    """

    kind: ClassVar[str] = "policy"

    @abstractmethod
    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the desired thrust over the next step [N], Hill frame, shape (R, 3).

        Args:
            view: The state at the beginning of the step.
            limits: What the agent's controllers can give.
        """

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that the policy remembers, each with its shape for one agent. None by default."""
        return {}
