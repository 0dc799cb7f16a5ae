"""Base of the policies that are written, not trained."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import SCRIPTED_POLICY, View
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray

__all__ = ["SCRIPTED_POLICY", "ScriptedPolicy", "ThrustLimits", "shortened"]


@dataclass(frozen=True)
class ThrustLimits:
    """What the controllers of an agent can give along each axis [N], of the whole control also about each [N m].

    Attributes:
        low: Smallest thrust, shape (3,), or control, shape (C,).
        high: Largest thrust, shape (3,), or control, shape (C,).
    """

    low: FloatArray
    high: FloatArray


class ScriptedPolicy(Plugin):
    """Flies the deputies of a group of agents: called once a step with a `View`, it returns the thrust to hold.

    A vehicle that turns is given the thrust in body axes and no moments; a policy that sets `commands_attitude` returns
    its whole control instead, shape (R, C): thrusts, then moments, along body axes.

    The thrust is clipped to the controllers' limits and passes the safety filter, as a trained policy's does. A policy
    sees the whole state. What it remembers it declares in `memory` and writes in place, through
    ``view.memory(SCRIPTED_POLICY, array)``, at its call; the arrays are filled anew at every reset.

    Class attributes:
        commands_attitude: Whether it returns the whole control.
        needs: Names of what it reads of the task, in `View`, `World` or the state, such as ``sun_angle``. A task that
            lacks one is refused before an episode starts; without a declaration, when the policy reads it.
    """

    kind: ClassVar[str] = "policy"
    commands_attitude: ClassVar[bool] = False
    needs: ClassVar[tuple[str, ...]] = ()

    def needed(self) -> tuple[str, ...]:
        """Return `needs`, and those of policies that it calls."""
        return self.needs

    @abstractmethod
    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the desired thrust over the next step [N], Hill frame, shape (R, 3), or the control, shape (R, C).

        Args:
            view: The state at the beginning of the step.
            limits: What the agent's controllers can give.
        """

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that the policy remembers, each with its shape for one agent. None by default."""
        return {}


def shortened(thrust: FloatArray, limits: ThrustLimits) -> FloatArray:
    """Return thrusts with one factor for all axes, at most 1, that brings them within their limits, shape (R, 3)."""
    room = np.where(thrust > 0.0, limits.high, -limits.low)
    factor = np.min(room / np.maximum(np.abs(thrust), 1e-12), axis=1)
    return np.asarray(thrust * np.minimum(factor, 1.0)[:, None])
