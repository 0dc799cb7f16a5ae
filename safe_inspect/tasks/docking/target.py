"""`TumblingTarget`: a rigid body that tumbles about the origin, with a mating point and a shape to avoid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.dynamics.attitude.rigid_body import rotate_freely
from safe_inspect.dynamics.rotation_row import rotated, rotated_back
from safe_inspect.geometry.distance import lengths
from safe_inspect.geometry.oriented_boxes import BoxArrays, box_distance
from safe_inspect.simulators import OfView, OwnOfView, PassiveComponent, RunningComponent, State, View, World
from safe_inspect.tasks.docking.shape import (
    ENVISAT_BOXES,
    ENVISAT_INERTIA,
    Matrix3,
    TargetBox,
    boxes_in_model,
    boxes_in_principal_axes,
)
from safe_inspect.tasks.docking.tumble_parameter import tumble_states
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray
from safe_inspect.units import Length


class _TargetBody(NamedTuple):
    """Rigid body in its principal axes T.

    Attributes:
        inertia: Principal moments, up to a factor, shape (3,).
        mating_point: Position of the chaser's centre when docked [m], shape (3,).
        boxes: Shape of the body.
    """

    inertia: FloatArray
    mating_point: FloatArray
    boxes: BoxArrays


class _TargetArrays(NamedTuple):
    """Arrays of N environments that describe the target; all but the first two are computed from these two.

    Attributes:
        orientation: Attitude q_WT, shape (N, 4).
        angular_velocity: Angular velocity in T [rad/s], shape (N, 3).
        position: Mating point in W [m], shape (N, 3).
        velocity: Velocity of the mating point in W [m/s], shape (N, 3).
        clearance: Signed distance of each chaser's centre to the boxes [m], shape (N, D).
        least_clearance: Smallest clearance since the reset [m], shape (N, D).
    """

    orientation: FloatArray
    angular_velocity: FloatArray
    position: FloatArray
    velocity: FloatArray
    clearance: FloatArray
    least_clearance: FloatArray


@njit
def _follow_target(body: _TargetBody, dt: float, steps: int, arrays: _TargetArrays, chasers: FloatArray) -> None:
    """Advance the target of each environment without torque, and write the quantities that depend on its attitude.

    Args:
        body: The target.
        dt: Step of the integration [s].
        steps: Number of these steps; 0 leaves the attitude unchanged.
        arrays: The arrays, read and written.
        chasers: Positions of the bodies, the chasers first [m], shape (N, B, 3).
    """
    j, m = (body.inertia[0], body.inertia[1], body.inertia[2]), body.mating_point
    for n in range(arrays.orientation.shape[0]):
        q, w = arrays.orientation[n], arrays.angular_velocity[n]
        rotate_freely(j, q, w, dt, steps)
        position = rotated(q, m[0], m[1], m[2])
        velocity = rotated(q, w[1] * m[2] - w[2] * m[1], w[2] * m[0] - w[0] * m[2], w[0] * m[1] - w[1] * m[0])
        for i in range(3):
            arrays.position[n, i] = position[i]
            arrays.velocity[n, i] = velocity[i]
        for d in range(arrays.clearance.shape[1]):
            p = rotated_back(q, chasers[n, d, 0], chasers[n, d, 1], chasers[n, d, 2])
            clearance = box_distance(body.boxes, p[0], p[1], p[2])
            arrays.clearance[n, d] = clearance
            arrays.least_clearance[n, d] = min(arrays.least_clearance[n, d], clearance)


_TUMBLE = "target_tumble"
#: Longest step of the fourth-order Runge-Kutta method [s].
_LONGEST_STEP = 0.5
_AT_REST: tuple[Any, Any] = ((0.0, 0.0, 0.0, 1.0), 0.0)
#: Names of the arrays, in the order of `_TargetArrays`.
_OF_TARGET = ("target_orientation", "target_angular_velocity", "mating_point_position", "mating_point_velocity")
_OF_CHASER = ("clearance", "least_clearance")


class TumblingTarget(PassiveComponent):
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
    """

    parameters: ClassVar[Mapping[str, str | None]] = {_TUMBLE: None}

    boxes: tuple[TargetBox, ...] = Field(default=ENVISAT_BOXES, min_length=1)
    inertia: Matrix3 = ENVISAT_INERTIA
    scale: float = Field(default=0.05, gt=0)
    mating_point: tuple[Length, Length, Length] = (0.0, 0.45, 0.0)

    @field_validator("inertia")
    @classmethod
    def _of_a_body(cls, value: Matrix3) -> Matrix3:
        principal_axes(np.array(value))
        return value

    @property
    def radii(self) -> Mapping[str, float]:
        """Radius of the sphere that the target sweeps [m]."""
        return {"target": float(self.scale * lengths(boxes_in_model(self.boxes).vertices).max())}

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running target."""
        moments, rotation = principal_axes(np.array(self.inertia))
        boxes = boxes_in_principal_axes(self.boxes, self.scale, rotation)
        body = _TargetBody(moments / moments[2], np.array(self.mating_point, dtype=np.float64), boxes)
        steps = math.ceil(world.step_size / _LONGEST_STEP - 1e-9)
        return _RunningTarget(body, world.step_size / steps, steps, world.num_deputies)


class _RunningTarget(RunningComponent):
    recorded = _OF_TARGET[:2]
    offered = {**dict.fromkeys(_OF_TARGET, OfView), **dict.fromkeys(_OF_CHASER, OwnOfView)}  # noqa: RUF012 - never written
    figures = {  # noqa: RUF012 - never written
        "mating_point_distance": ("distance to mating point", "m"),
        "mating_point_speed": ("speed at mating point", "m/s"),
        "least_clearance": ("least clearance", "m"),
    }

    def __init__(self, body: _TargetBody, dt: float, steps: int, num_deputies: int) -> None:
        self._body, self._dt, self._steps = body, dt, steps
        sizes = dict.fromkeys(_OF_CHASER, (num_deputies,)) | dict.fromkeys(_OF_TARGET, (3,)) | {_OF_TARGET[0]: (4,)}
        self.arrays = {name: ArraySpec(sizes[name]) for name in (*_OF_TARGET, *_OF_CHASER)}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        attitudes, drawn = state["target_orientation"], values.get(_TUMBLE)
        started = _AT_REST if drawn is None else tumble_states(_TUMBLE, drawn, len(attitudes))
        attitudes[...], state["target_angular_velocity"][...] = started
        state["least_clearance"][...] = np.inf
        self._follow(state, 0)

    def step(self, state: State, running: BoolArray) -> None:
        self._follow(state, self._steps)

    def of_world(self) -> Mapping[str, Any]:
        return {"target_body": self._body}

    def info(self, view: View) -> dict[str, AnyArray]:
        return {
            "mating_point_distance": lengths(view.position - view.mating_point_position),
            "mating_point_speed": lengths(view.velocity - view.mating_point_velocity),
            "least_clearance": view.least_clearance,
        }

    def shared_state(self, team: Any) -> tuple[AnyArray, ...]:
        return team.target_orientation, team.target_angular_velocity

    def _follow(self, state: State, steps: int) -> None:
        arrays = _TargetArrays(*(state[name] for name in (*_OF_TARGET, *_OF_CHASER)))
        _follow_target(self._body, self._dt, steps, arrays, state.position)
