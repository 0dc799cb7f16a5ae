"""`DockingAutopilot` and `DockingController`: dock with a chief at rest, and with a tumbling target."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.dynamics.quaternion import rotate
from safe_inspect.geometry.distance import lengths
from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits, dot_rows, shortened
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.view import View
from safe_inspect.tasks.docking.speed_limit import SpeedLimit
from safe_inspect.types import FloatArray
from safe_inspect.units import Angle, PositiveAngularRate


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
        position, velocity = np.empty_like(view.position), np.empty_like(view.velocity)
        coasting = np.zeros_like(position)
        propagate(for_kernel(view.position), for_kernel(view.velocity), coasting, phi, gamma, position, velocity)
        distance = lengths(position)
        threshold, near, slope, _ = self.limit_line(view.world)
        speed = self.share * (threshold + slope * np.maximum(distance - near, 0.0))
        wanted = -position * (speed / np.maximum(distance, 1e-9))[:, None]
        mass = view.mass[:, None]
        thrust = mass * (wanted - velocity) / np.diag(gamma[3:])
        return shortened(thrust, limits)  # keeps the direction of the velocity change


#: Distance of the reference from the target's centre outside the corridor [m], half angle of the corridor about the
#: direction of the mating point [rad], and upper bound of wn / (2 zeta) |dp| [m/s].
_STANDOFF, _CORRIDOR, _APPROACH_SPEED = 1.35, 0.6, 0.1


class DockingController(ScriptedPolicy):
    """Controller that docks with a `TumblingTarget` by proportional-derivative control to a rotating reference.

        u = m (a_r + wn^2 dp + 2 zeta wn dv),        a_r = w x (w x r)

    where dp and dv are the position and the velocity of the reference r relative to the chaser, and w is the angular
    velocity of the target, with which the reference rotates. While the angle between chaser and mating point, as seen
    from the target's centre, is more than 0.6 rad, the reference is 1.35 m from the centre, on the great circle towards
    the mating point; within this corridor it descends in proportion to the remaining angle. The damping ratio zeta is
    1, and the speed of the approach to a distant reference is at most 0.1 m/s. The controller uses the true motion of
    the target and does not plan: it is a baseline for learned policies.

    Attributes:
        frequency: Natural frequency wn [rad/s].
        lead: Largest angle from the chaser to the reference [rad].
    """

    needs: ClassVar[tuple[str, ...]] = ("mating_point_position", "target_orientation", "target_angular_velocity")

    frequency: PositiveAngularRate = 0.3
    lead: Angle = Field(default=0.5, gt=0, lt=math.pi)

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the thrust [N], shape (R, 3)."""
        mating, position, velocity = view.mating_point_position, view.position, view.velocity
        turn = rotate(view.target_orientation, view.target_angular_velocity)
        reach, distance = lengths(mating), np.maximum(lengths(position), 1e-9)
        n, p = mating / np.maximum(reach, 1e-9)[:, None], position / distance[:, None]
        angle = np.arccos(np.clip(dot_rows(n, p), -1.0, 1.0))
        across = n - dot_rows(n, p)[:, None] * p
        across /= np.maximum(lengths(across), 1e-9)[:, None]
        step = np.minimum(angle, self.lead)[:, None]
        direction = np.cos(step) * p + np.sin(step) * across
        height = reach + (_STANDOFF - reach) * np.minimum(angle / _CORRIDOR, 1.0)
        reference = np.where((angle < _CORRIDOR)[:, None], n, direction) * height[:, None]
        reference_velocity = np.cross(turn, reference)
        to_reference = reference - position
        pull = self.frequency / 2.0 * to_reference
        pull *= np.minimum(1.0, _APPROACH_SPEED / np.maximum(lengths(pull), 1e-9))[:, None]
        gain = 2.0 * self.frequency
        wanted = np.cross(turn, reference_velocity) + gain * (pull + reference_velocity - velocity)
        mass = view.mass[:, None]
        return np.asarray(np.clip(mass * wanted, limits.low, limits.high))
