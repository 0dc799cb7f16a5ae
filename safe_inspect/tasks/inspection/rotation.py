"""`ChiefRotation`: a body with inspection points that rotates at a constant rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from pydantic import field_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.dynamics.rotation_row import Components, rotated, rotated_back
from safe_inspect.errors import ArgumentError
from safe_inspect.geometry.clusters import direction_to_nearest
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.simulators.component import Component, RunningComponent
from safe_inspect.simulators.offers import OfTeam, OfView
from safe_inspect.simulators.resets.initializers import require_length
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.free_rotation import (
    FreeRotation,
    draw_rotations,
    frame_angles,
    in_frame,
    rotate_freely,
)
from safe_inspect.tasks.inspection.sun import LIGHT
from safe_inspect.types import ArraySpec, BoolArray, FloatArray
from safe_inspect.units import AngularRate

_ANGLE, _ORIENTATION = "chief_angle", "chief_orientation"
#: Arrays of a body that rotates freely: attitude to inertial axes and angular velocity in body axes.
_INERTIAL, _SPIN = "chief_inertial", "chief_spin"


class BodyAxes(NamedTuple):
    """Attitude of a rotating body in N environments, and the B bodies and the sun expressed in its axes.

    Attributes:
        angle: Angle of rotation since the reset, not wrapped [rad], shape (N,).
        orientation: Quaternion from the axes of the rotating body to Hill's frame, shape (N, 4).
        position: Positions of the B bodies relative to the rotating body, in its axes [m], shape (N, B, 3).
        sun: Unit vectors to the sun in the axes of the rotating body [-], shape (N, 3).
        attitude: Quaternions from the axes of each of the B bodies to those of the rotating body, shape (N, B, 4);
            (N, 0, 4) if the bodies are points.
    """

    angle: FloatArray
    orientation: FloatArray
    position: FloatArray
    sun: FloatArray
    attitude: FloatArray


@njit
def turn_body(
    turn: float,
    axis: Components,
    body: int,
    position: FloatArray,
    sun: FloatArray,
    attitude: FloatArray,
    axes: BodyAxes,
) -> None:
    """Rotate a body about an axis of Hill's frame, and write the bodies and the sun in its axes.

    Args:
        turn: Angle to add [rad].
        axis: Unit vector of the axis.
        body: Index of the body.
        position: Positions of the bodies, Hill frame [m], shape (N, B, 3).
        sun: Unit vectors to the sun, Hill frame [-], shape (N, 3).
        attitude: Attitudes of the bodies to Hill's frame, shape (N, B, 4); (N, 0, 4) if they are points.
        axes: Data in the axes of the body, read and written.
    """
    for n in range(axes.angle.shape[0]):
        axes.angle[n] += turn
        sine = math.sin(0.5 * axes.angle[n])
        for k in range(3):
            axes.orientation[n, k] = sine * axis[k]
        axes.orientation[n, 3] = math.cos(0.5 * axes.angle[n])
    write_in_axes(body, position, sun, attitude, axes)


@njit
def write_in_axes(body: int, position: FloatArray, sun: FloatArray, attitude: FloatArray, axes: BodyAxes) -> None:
    """Write the bodies and the sun in the axes of a body with a known orientation; see `turn_body`."""
    for n in range(axes.orientation.shape[0]):
        o = axes.orientation[n]
        x, y, z, w = o[0], o[1], o[2], o[3]
        q = (x, y, z, w)
        for b in range(position.shape[1]):
            p, origin = position[n, b], position[n, body]
            seen = rotated_back(q, p[0] - origin[0], p[1] - origin[1], p[2] - origin[2])
            for k in range(3):
                axes.position[n, b, k] = seen[k]
        seen = rotated_back(q, sun[n, 0], sun[n, 1], sun[n, 2])
        for k in range(3):
            axes.sun[n, k] = seen[k]
        for b in range(attitude.shape[1]):  # Conjugate of q times the attitude.
            a = attitude[n, b]
            axes.attitude[n, b, 0] = w * a[0] - x * a[3] - y * a[2] + z * a[1]
            axes.attitude[n, b, 1] = w * a[1] + x * a[2] - y * a[3] - z * a[0]
            axes.attitude[n, b, 2] = w * a[2] - x * a[1] + y * a[0] - z * a[3]
            axes.attitude[n, b, 3] = w * a[3] + x * a[0] + y * a[1] + z * a[2]


@njit
def turned_direction_to_nearest(
    orientation: FloatArray,
    viewer: FloatArray,
    body: FloatArray,
    centres: FloatArray,
    count: int,
    direction: FloatArray,
) -> None:
    """Call `direction_to_nearest` in the axes of a rotating body, and write the direction in Hill's frame.

    Args:
        orientation: Attitude of the body, from its axes to Hill's frame, shape (4,).
        viewer: As in `direction_to_nearest`, in the body's axes.
        body: As in `direction_to_nearest`, in the body's axes.
        centres: As in `direction_to_nearest`, in the body's axes.
        count: As in `direction_to_nearest`.
        direction: Receives the direction [-], Hill frame, shape (3,).
    """
    direction_to_nearest(viewer, body, centres, count, direction)
    turned = rotated(orientation, direction[0], direction[1], direction[2])
    for k in range(3):
        direction[k] = turned[k]


def array_in_axes_of(entity: str, world: World, name: str) -> str:
    """Return the name of the array of ``position``, ``sun_direction`` or ``orientation`` in the axes of a body.

    With an eclipse, ``sun_direction`` means the direction of the light, see `Sun`.

    Args:
        entity: Name of the body; the axes of a body that does not rotate are Hill's.
        world: The constant data of the simulation.
        name: Name of the array in Hill's frame.
    """
    if entity == rotating_body(world):
        return f"axes/{entity}/{name}"
    return LIGHT if name == "sun_direction" and "shadow" in world.offers.world else name


def rotating_body(world: World) -> str | None:
    """Return the name of the rotating body, or None if there is none."""
    found: str | None = world.offers.world.get("rotating_body")
    return found


class ChiefRotation(Component):
    """Body that rotates at a constant angular velocity or freely; its points, normals and priority vector rotate too.

    With a constant angular velocity, its axes are Hill's at the reset. In safe-autonomy-sims outside of CoRL, the chief
    does not rotate in inertial space: ``[0, 0, -n]`` with the mean motion n. Arrays: ``chief_angle``, not wrapped
    [rad], shape (N,), ``chief_orientation``, the attitude from the body's axes to Hill's frame [x, y, z, w], shape
    (N, 4), and all bodies and the sun in the body's axes; of a free rotation also ``chief_inertial``, the attitude to
    inertial axes, shape (N, 4), and ``chief_spin``, the angular velocity in body axes [rad/s], shape (N, 3). The
    component ``Sun`` must come before this one, `InspectionPoints` after it.

    Attributes:
        entity_name: The body.
        angular_velocity: Angular velocity relative to Hill's frame, along Hill's axes [rad/s]; not zero.
        free: Torque-free rotation in inertial space instead; None: the angular velocity is constant.
    """

    entity_name: EntityName = "chief"
    angular_velocity: tuple[AngularRate, AngularRate, AngularRate] = (0.0, 0.0, -0.001027)

    free: FreeRotation | None = None

    _has_length = field_validator("angular_velocity")(require_length)

    @property
    def bodies(self) -> tuple[str, ...]:
        """The rotating body."""
        return (self.entity_name,)

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds: the rotation does not affect the motion of deputies."""
        return NO_DISTURBANCE

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running rotation.

        Raises:
            ArgumentError: The order of the components is wrong.
        """
        if "sun_direction" not in world.offers.view or "points" in world.offers.world:
            raise ArgumentError(
                "ChiefRotation must come after Sun and before InspectionPoints; change the order of `components`"
            )
        if self.free is not None:
            return _FreelyRotating(self.entity_name, self.free, world)
        rate = math.hypot(*self.angular_velocity)
        x, y, z = (component / rate for component in self.angular_velocity)
        return _SteadilyRotating(self.entity_name, rate * world.step_size, (x, y, z), world)


class _Rotating(RunningComponent):
    """A rotating body; a subclass writes its orientation."""

    recorded = (_ORIENTATION,)

    def __init__(self, entity: str, world: World) -> None:
        self._entity, self._body = entity, world.bodies[entity]
        bodies, turning = len(world.bodies), "turning_body" in world.offers.world
        self._names = tuple(f"axes/{entity}/{name}" for name in ("position", "sun_direction", "orientation"))
        sizes = ((bodies, 3), (3,), (bodies if turning else 0, 4))
        self.arrays = {_ANGLE: ArraySpec(()), _ORIENTATION: ArraySpec((4,))}
        self.arrays |= {name: ArraySpec(size) for name, size in zip(self._names, sizes, strict=True)}

    def of_world(self) -> Mapping[str, Any]:
        return {"rotating_body": self._entity}

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {_ORIENTATION: OfView(_ORIENTATION)}

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        return {_ORIENTATION: OfTeam(_ORIENTATION)}

    def shared_state(self, team: Any) -> tuple[Any, ...]:
        return (team.chief_orientation,)

    def _seen(self, state: State) -> tuple[int, FloatArray, FloatArray, FloatArray, BodyAxes]:
        """Return the last arguments of `turn_body`."""
        arrays = state.arrays
        attitude = arrays.get("orientation", np.zeros((state.num_envs, 0, 4)))
        axes = BodyAxes(arrays[_ANGLE], arrays[_ORIENTATION], *(arrays[name] for name in self._names))
        return self._body, state.position, arrays.get(LIGHT, arrays["sun_direction"]), attitude, axes


class _SteadilyRotating(_Rotating):
    def __init__(self, entity: str, turn: float, axis: Components, world: World) -> None:
        super().__init__(entity, world)
        self._turn, self._axis = turn, axis

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        turn_body(0.0, self._axis, *self._seen(state))

    def step(self, state: State, running: BoolArray) -> None:
        turn_body(self._turn, self._axis, *self._seen(state))


class _FreelyRotating(_Rotating):
    def __init__(self, entity: str, free: FreeRotation, world: World) -> None:
        super().__init__(entity, world)
        self._steps, self._mean_motion = free.steps(world.step_size), float(world.mean_motion)
        self._orbit = world.offers.world.get("orbit")
        self.arrays = {**self.arrays, _INERTIAL: ArraySpec((4,)), _SPIN: ArraySpec((3,))}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        draw_rotations(state["key"], self._steps, state[_INERTIAL], state[_SPIN])
        self._follow(state)

    def step(self, state: State, running: BoolArray) -> None:
        rotate_freely(self._steps, state[_INERTIAL], state[_SPIN])
        self._follow(state)

    def _follow(self, state: State) -> None:
        orbit = None if self._orbit is None else state[self._orbit]
        angles = frame_angles(orbit, self._mean_motion, state["time"])
        in_frame(angles, state[_INERTIAL], state[_ORIENTATION])
        write_in_axes(*self._seen(state))
