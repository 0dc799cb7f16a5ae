"""`DockingAutopilot`: flies to the origin of Hill's frame at a fraction of the docking speed limit."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.cwh import transition
from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits, shortened
from safe_inspect.simulators.view import View
from safe_inspect.tasks.docking.speed_limit import SpeedLimit
from safe_inspect.types import FloatArray


class DockingAutopilot(SpeedLimit, ScriptedPolicy):
    """Autopilot that flies to the origin at a share of the docking speed limit.

    Let P be the position that the deputy reaches after one step without thrust. The thrust of the step makes the
    velocity after the step point from P to the origin, with a speed of `share` times the speed limit at P. This is
    exact in Clohessy-Wiltshire dynamics, unless the thrust exceeds the limits of the controllers.

    Attributes:
        share: Desired share of the speed limit [-].
    """

    needs: ClassVar[tuple[str, ...]] = ("mean_motion",)

    share: float = Field(default=0.98, gt=0, le=1)

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the thrust [N], shape (R, 3)."""
        phi, gamma = transition(view.world.mean_motion, 1.0, view.world.step_size)
        state = [*view.position.T, *view.velocity.T]
        coasted = [sum(phi[i, j] * state[j] for j in range(6)) for i in range(6)]
        position, velocity = np.stack(coasted[:3], axis=-1), np.stack(coasted[3:], axis=-1)
        distance = np.sqrt(position[:, 0] ** 2 + position[:, 1] ** 2 + position[:, 2] ** 2)
        threshold, near, slope, _ = self.limit_line(view.world)
        speed = self.share * (threshold + slope * np.maximum(distance - near, 0.0))
        wanted = -position * (speed / np.maximum(distance, 1e-9))[:, None]
        mass = np.broadcast_to(view.mass, (view.num_rows,))[:, None]
        thrust = mass * (wanted - velocity) / np.diag(gamma[3:])
        return shortened(thrust, limits)  # keeps the direction of the velocity change
