"""Base class of scripted policies, which are programmed instead of trained."""

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
    """Limits of an agent's controllers along each axis [N]; for a whole control also the moments about each axis [N m].

    Attributes:
        low: Smallest thrust, shape (3,), or control, shape (C,).
        high: Largest thrust, shape (3,), or control, shape (C,).
    """

    low: FloatArray
    high: FloatArray


class ScriptedPolicy(Plugin):
    """Base class of policies that control the deputies of a group of agents without training.

    A policy is called once a step with a `View` and returns the thrust that is held during the step.

    For a vehicle that turns, the thrust is in body axes and the moments are zero; a policy that sets
    `commands_attitude` returns the whole control instead, shape (R, C): thrusts, then moments, along body axes.

    The thrust is clipped to the controllers' limits and passes through the safety filter, like that of a trained
    policy. A policy observes the full state. State that it keeps between steps is declared in `memory` and written in
    place, through ``view.memory(SCRIPTED_POLICY, array)``, when the policy is called; the arrays are initialised again
    at every reset.

    Class attributes:
        commands_attitude: Whether it returns the whole control.
        needs: Names of the quantities of the task that it reads from `View`, `World` or the state, such as
            ``sun_angle``. A task without one of them is refused before an episode starts; without a declaration, the
            error is raised when the policy reads the quantity.
    """

    kind: ClassVar[str] = "policy"
    commands_attitude: ClassVar[bool] = False
    needs: ClassVar[tuple[str, ...]] = ()

    def needed(self) -> tuple[str, ...]:
        """Return `needs`, together with the needs of policies that this policy calls."""
        return self.needs

    @abstractmethod
    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the desired thrust over the next step [N], Hill frame, shape (R, 3), or the control, shape (R, C).

        Args:
            view: The state at the start of the step.
            limits: Limits of the agent's controllers.
        """

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that the policy keeps between steps, with their shapes for one agent; none by default."""
        return {}


def shortened(thrust: FloatArray, limits: ThrustLimits) -> FloatArray:
    """Return thrusts scaled to within their limits by one factor for all axes, at most 1, shape (R, 3)."""
    room = np.where(thrust > 0.0, limits.high, -limits.low)
    factor = np.min(room / np.maximum(np.abs(thrust), 1e-12), axis=1)
    return np.asarray(thrust * np.minimum(factor, 1.0)[:, None])


def dot_rows(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the dot products of rows of three elements, shape (R,)."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])
