"""`SixDofInspector`: flies an inspection and points the camera at the chief."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import field_validator

from safe_inspect.dynamics.quaternion import exp, multiply, rotate_back
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import EntityName, Plugin
from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits, cross_rows, dot_rows, shortened, size_of_rows
from safe_inspect.policies.inspector import NaturalMotionInspector
from safe_inspect.simulators.resets.attitudes import require_length
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray

#: Largest magnitude of the desired angular velocity as a share of the rate limit [-].
_RATE_SHARE = 0.98


class SixDofInspector(ScriptedPolicy):
    """Inspector for vehicles that turn: it points the camera at a body while another policy commands the thrust.

    Let phi be the rotation vector of the smallest rotation that takes the camera's axis to the line of sight, e the
    error of the angular velocity w with respect to that of the line of sight, and T the step. The next angular velocity
    is

        w' = w + phi / T - 3/2 e,        |w'| <= 0.98 rate limit

    in body axes, and the moment is J (w' - w) / T. If no limit is reached, moments of this size, held over the steps,
    take both errors to zero in two steps (the deadbeat controller of a double integrator); a long turn first proceeds
    at the rate limit. The thrust of the other policy is rotated into body axes with the attitude expected in the middle
    of the step.

    Attributes:
        translation: The policy that commands the thrust, along Hill's axes.
        entity_name: The body at which the camera points.
        initial_sensor_unit_vec: Axis of the camera in body axes; any length.
    """

    commands_attitude: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("turning_body", "orientation", "angular_velocity")

    translation: functor_field("policy") = NaturalMotionInspector(field_of_view="60 deg", near=20.0)  # type: ignore[valid-type]
    entity_name: EntityName = "chief"
    initial_sensor_unit_vec: tuple[float, float, float] = (1.0, 0.0, 0.0)

    _has_length = field_validator("initial_sensor_unit_vec")(require_length)

    @field_validator("translation")
    @classmethod
    def _gives_thrust(cls, value: Plugin) -> Plugin:
        if isinstance(value, ScriptedPolicy) and value.commands_attitude:
            raise ValueError(f"{value.registered_name} commands the attitude itself; use one that only commands thrust")
        return value

    def needed(self) -> tuple[str, ...]:
        """Return the needs of this policy and of the other policy."""
        translation: Any = self.translation
        return (*self.needs, *translation.needed())

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the memory of the other policy."""
        translation: Any = self.translation
        remembered: Mapping[str, ArraySpec] = translation.memory(world)
        return remembered

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the control along body axes [N, N m], shape (R, 6)."""
        translation: Any = self.translation
        thrust_limits = ThrustLimits(limits.low[:3], limits.high[:3])
        thrust = translation(view, thrust_limits)
        vehicle, step = view.world.turning_body, view.world.step_size
        q, w = view.per_agent(view.state["orientation"]), view.per_agent(view.state["angular_velocity"])
        frame = rotate_back(q, np.tile([0.0, 0.0, vehicle.frame_rate], (view.num_rows, 1)))
        way = view.entity_position(self.entity_name) - view.position
        sight = rotate_back(q, _turn_of(way, view.entity_velocity(self.entity_name) - view.velocity)) + frame
        phi = self._rotation(rotate_back(q, way))
        wanted = w + phi / step - 1.5 * (w - sight)
        if vehicle.rate_limit is not None:
            size = size_of_rows(wanted)
            wanted *= np.minimum(1.0, _RATE_SHARE * vehicle.rate_limit / np.maximum(size, 1e-12))[:, None]
        change = (wanted - w) / step
        moment = shortened(change * np.array(vehicle.inertia), ThrustLimits(limits.low[3:], limits.high[3:]))
        middle = multiply(q, exp(0.5 * step * (w - frame + 0.25 * step * moment / np.array(vehicle.inertia))))
        along = rotate_back(middle, thrust) if vehicle.turns_thrust else thrust
        return np.concatenate((shortened(along, thrust_limits), moment), axis=1)

    def _rotation(self, way: FloatArray) -> FloatArray:
        """Return the rotation vectors that take the camera's axis to a direction, body axes [rad], shape (R, 3)."""
        axis = np.array(self.initial_sensor_unit_vec) / np.linalg.norm(self.initial_sensor_unit_vec)
        least = np.eye(3)[np.abs(axis).argmin()]
        across = np.cross(axis, least) / np.linalg.norm(np.cross(axis, least))
        normal = cross_rows(np.broadcast_to(axis, way.shape), way)
        size, along = size_of_rows(normal), dot_rows(np.broadcast_to(axis, way.shape), way)
        straight = size < 1e-12  # ahead or exactly behind: use any perpendicular axis
        unit = np.where(straight[:, None], across, normal / np.where(straight, 1.0, size)[:, None])
        return np.asarray(np.arctan2(size, along)[:, None] * unit)


def _turn_of(way: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the angular velocity of a line of sight, Hill frame [rad/s], shape (R, 3)."""
    return np.asarray(cross_rows(way, rate) / np.maximum(dot_rows(way, way), 1e-12)[:, None])
