"""`TumblingTarget`: a rigid body that tumbles about the origin, with a mating point and a shape to avoid."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, field_validator

from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.geometry.distance import lengths
from safe_inspect.simulators.component import Component, RunningComponent
from safe_inspect.simulators.offers import OfTeam, OfView
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.tasks.rendezvous.envisat import ENVISAT_BOXES, ENVISAT_INERTIA
from safe_inspect.tasks.rendezvous.motion import TargetArrays, TargetBody, follow_target
from safe_inspect.tasks.rendezvous.shape import Matrix3, TargetBox, boxes_in_principal_axes
from safe_inspect.tasks.rendezvous.tumble_parameter import tumble_states
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray
from safe_inspect.units import Length, PositiveDuration

_TUMBLE = "target_tumble"
_AT_REST: Mapping[str, Any] = {"orientation": (0.0, 0.0, 0.0, 1.0), "angular_velocity": 0.0}
#: Names of the arrays, in the order of `TargetArrays`.
_OF_TARGET = ("target_orientation", "target_angular_velocity", "mating_point_position", "mating_point_velocity")
_OF_CHASER = ("clearance", "least_clearance")


class TumblingTarget(Component):
    """Rigid body that tumbles without torque about its centre of mass, the origin of the inertial frame W.

        J w' = -w x J w,        q' = q [w, 0] / 2

    with q = q_WT and w in the principal axes T, J1 <= J2 <= J3. Arrays: ``target_orientation`` [x, y, z, w], shape
    (N, 4), ``target_angular_velocity`` in T [rad/s], shape (N, 3), ``mating_point_position`` [m] and
    ``mating_point_velocity`` [m/s] in W, shape (N, 3), ``clearance``, the signed distance of each chaser's centre to
    the boxes, and ``least_clearance``, the smallest since the reset [m], shape (N, D). A reset takes the attitude and
    angular velocity from the reset parameter ``target_tumble``, see `TumbleParameter`; without one, the target is at
    rest with T aligned with W. By default, the target is Envisat.

    Attributes:
        boxes: Boxes that cover the target, in its model frame M at full scale, the centre of mass at the origin.
        inertia: Inertia about the centre of mass in M [kg m^2]; a common factor does not matter.
        scale: Size of the target relative to full scale [-].
        mating_point: Position of the chaser's centre when docked, in T [m]; not scaled.
        integration_step: Longest step of the fourth-order Runge-Kutta method [s].
    """

    parameters: ClassVar[Mapping[str, str | None]] = {_TUMBLE: None}

    boxes: tuple[TargetBox, ...] = Field(default=ENVISAT_BOXES, min_length=1)
    inertia: Matrix3 = ENVISAT_INERTIA
    scale: float = Field(default=0.05, gt=0)
    mating_point: tuple[Length, Length, Length] = (0.0, 0.45, 0.0)
    integration_step: PositiveDuration = 0.5

    @field_validator("inertia")
    @classmethod
    def _of_a_body(cls, value: Matrix3) -> Matrix3:
        principal_axes(np.array(value))
        return value

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds: the target does not affect the motion of deputies."""
        return NO_DISTURBANCE

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running target."""
        moments, rotation = principal_axes(np.array(self.inertia))
        boxes = boxes_in_principal_axes(self.boxes, self.scale, rotation)
        body = TargetBody(moments / moments[2], np.array(self.mating_point, dtype=np.float64), boxes)
        steps = math.ceil(world.step_size / self.integration_step - 1e-9)
        return _RunningTarget(body, world.step_size / steps, steps, world.num_deputies)


class _RunningTarget(RunningComponent):
    recorded = _OF_TARGET[:2]
    figures = {  # noqa: RUF012 - never written
        "mating_point_distance": ("distance to mating point", "m"),
        "mating_point_speed": ("speed at mating point", "m/s"),
        "least_clearance": ("least clearance", "m"),
    }

    def __init__(self, body: TargetBody, dt: float, steps: int, num_deputies: int) -> None:
        self._body, self._dt, self._steps = body, dt, steps
        sizes = dict.fromkeys(_OF_CHASER, (num_deputies,)) | dict.fromkeys(_OF_TARGET, (3,)) | {_OF_TARGET[0]: (4,)}
        self.arrays = {name: ArraySpec(sizes[name]) for name in (*_OF_TARGET, *_OF_CHASER)}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        orientation, rate = tumble_states(_TUMBLE, values.get(_TUMBLE, _AT_REST))
        state["target_orientation"][...], state["target_angular_velocity"][...] = orientation, rate
        state["least_clearance"][...] = np.inf
        self._follow(state, 0)

    def step(self, state: State, running: BoolArray) -> None:
        self._follow(state, self._steps)

    def of_world(self) -> Mapping[str, Any]:
        return {"target_body": self._body}

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OfView(name) for name in _OF_TARGET} | {"clearance": _clearance}

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OfTeam(name) for name in self.arrays}

    def info(self, view: View) -> dict[str, AnyArray]:
        return {
            "mating_point_distance": lengths(view.position - view.mating_point_position),
            "mating_point_speed": lengths(view.velocity - view.mating_point_velocity),
            "least_clearance": view.per_agent(view.state["least_clearance"]),
        }

    def shared_state(self, team: Any) -> tuple[AnyArray, ...]:
        return team.target_orientation, team.target_angular_velocity

    def _follow(self, state: State, steps: int) -> None:
        arrays = TargetArrays(*(state[name] for name in (*_OF_TARGET, *_OF_CHASER)))
        follow_target(self._body, self._dt, steps, arrays, state.position)


def _clearance(view: View) -> FloatArray:
    """Return the signed distance of each agent's centre to the target [m], shape (R,)."""
    return view.per_agent(view.state["clearance"])
