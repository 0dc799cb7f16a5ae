"""`ChiefRotation`: a body with inspection points that rotates at a constant rate, or freely in inertial space."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, field_validator, model_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.attitude.inertia import PrincipalMoments, principal_axes
from safe_inspect.dynamics.attitude.rigid_body import rotate_freely
from safe_inspect.dynamics.rotation_row import Components, product, rotated_back
from safe_inspect.errors import ArgumentError
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.random.splitmix import uniform_at
from safe_inspect.simulators import OfView, PassiveComponent, RunningComponent, State, World
from safe_inspect.simulators.resets.initializers import require_length
from safe_inspect.tasks.inspection.sun import LIGHT
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray
from safe_inspect.units import AngularRate, NonNegativeAngularRate

#: Number of the first sample; other components use those below 8,000.
_FIRST_DRAW = 8_000
#: Largest angle of an integration step [rad].
_LARGEST_TURN = 0.05


class FreeRotation(BaseModel):
    """Torque-free rotation; the attitude and the direction of the angular velocity are drawn uniformly at each reset.

    Attributes:
        inertia: Moments of inertia about the body's axes, which are its principal axes [kg m^2]; only their ratios
            matter.
        rate: Smallest and largest angular velocity in inertial space [rad/s], drawn uniformly.

    Raises:
        ValueError: No body has these moments of inertia, or the largest rate is below the smallest.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    inertia: PrincipalMoments
    rate: tuple[NonNegativeAngularRate, NonNegativeAngularRate] = (0.0, 0.0349)  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _possible(self) -> FreeRotation:
        principal_axes(np.diag(self.inertia))  # raises the error if no body has these moments
        if self.rate[0] > self.rate[1]:
            raise ValueError(f"the smallest `rate` {self.rate[0]:g} is above the largest {self.rate[1]:g}; swap them")
        return self

    def steps(self, step_size: float) -> _FreeSteps:
        """Return the constants of the integration of a step [s]."""
        # The angular velocity grows at most by the ratio of the moments, since energy and momentum are constant.
        fastest = self.rate[1] * max(self.inertia) / min(self.inertia)
        substeps = max(math.ceil(step_size * fastest / _LARGEST_TURN), 1)
        return _FreeSteps(self.inertia, self.rate, step_size / substeps, substeps)


class _FreeSteps(NamedTuple):
    """Constants: moments of inertia, range of rates [rad/s], integration step [s] and the number of these in a step."""

    inertia: tuple[float, float, float]
    rate: tuple[float, float]
    step: float
    substeps: int


@njit
def _draw_rotations(key: AnyArray, steps: _FreeSteps, inertial: FloatArray, spin: FloatArray) -> None:
    """Write the first attitudes to inertial axes, shape (N, 4), and angular velocities in body axes, shape (N, 3).

    Source: Shoemake, "Uniform random rotations", Graphics Gems III, 1992, for the attitudes.
    """
    for n in range(inertial.shape[0]):
        u = [uniform_at(key[n], 0, _FIRST_DRAW + k) for k in range(6)]
        a, b = 2.0 * math.pi * u[1], 2.0 * math.pi * u[2]
        inertial[n, 0], inertial[n, 1] = math.sqrt(1.0 - u[0]) * math.sin(a), math.sqrt(1.0 - u[0]) * math.cos(a)
        inertial[n, 2], inertial[n, 3] = math.sqrt(u[0]) * math.sin(b), math.sqrt(u[0]) * math.cos(b)
        rate = steps.rate[0] + (steps.rate[1] - steps.rate[0]) * u[3]
        z, around = 2.0 * u[4] - 1.0, 2.0 * math.pi * u[5]
        across = rate * math.sqrt(max(0.0, 1.0 - z * z))
        spin[n, 0], spin[n, 1], spin[n, 2] = across * math.cos(around), across * math.sin(around), rate * z


@njit
def rotate_bodies(steps: _FreeSteps, inertial: FloatArray, spin: FloatArray) -> None:
    """Advance attitudes, shape (N, 4), and angular velocities, shape (N, 3), by a step."""
    for n in range(inertial.shape[0]):
        rotate_freely(steps.inertia, inertial[n], spin[n], steps.step, steps.substeps)


@njit
def _in_frame(angles: FloatArray, inertial: FloatArray, orientation: FloatArray) -> None:
    """Write attitudes to Hill's frame, shape (N, 4), for attitudes to inertial axes.

    Args:
        angles: Node, inclination and argument of latitude of Hill's frame in inertial axes [rad], shape (N, 3).
        inertial: Attitudes to inertial axes, shape (N, 4).
        orientation: Output: attitudes to Hill's frame.
    """
    for n in range(inertial.shape[0]):
        node, tilt, latitude = -0.5 * angles[n, 0], -0.5 * angles[n, 1], -0.5 * angles[n, 2]
        q = (inertial[n, 0], inertial[n, 1], inertial[n, 2], inertial[n, 3])
        q = product((0.0, 0.0, math.sin(node), math.cos(node)), q)
        q = product((math.sin(tilt), 0.0, 0.0, math.cos(tilt)), q)
        q = product((0.0, 0.0, math.sin(latitude), math.cos(latitude)), q)
        for k in range(4):
            orientation[n, k] = q[k]


_ANGLE, _ORIENTATION = "chief_angle", "chief_orientation"
#: Arrays of a body that rotates freely: attitude to inertial axes and angular velocity in body axes.
_INERTIAL, _SPIN = "chief_inertial", "chief_spin"


class _BodyAxes(NamedTuple):
    """Attitude of a rotating body in N environments, and the B bodies and the sun expressed in its axes.

    Attributes:
        orientation: Quaternion from the axes of the rotating body to Hill's frame, shape (N, 4).
        position: Positions of the B bodies relative to the rotating body, in its axes [m], shape (N, B, 3).
        sun: Unit vectors to the sun in the axes of the rotating body [-], shape (N, 3).
        attitude: Quaternions from the axes of each of the B bodies to those of the rotating body, shape (N, B, 4);
            (N, 0, 4) if the bodies are points.
    """

    orientation: FloatArray
    position: FloatArray
    sun: FloatArray
    attitude: FloatArray


@njit
def _rotate_steadily(turn: float, axis: Components, angle: FloatArray, orientation: FloatArray) -> None:
    """Add an angle [rad] to those of rotation, shape (N,), and write the attitudes to Hill's frame, shape (N, 4).

    The axis of rotation is a unit vector in Hill's frame.
    """
    for n in range(angle.shape[0]):
        angle[n] += turn
        sine = math.sin(0.5 * angle[n])
        for k in range(3):
            orientation[n, k] = sine * axis[k]
        orientation[n, 3] = math.cos(0.5 * angle[n])


@njit
def _write_in_axes(body: int, position: FloatArray, sun: FloatArray, attitude: FloatArray, axes: _BodyAxes) -> None:
    """Write the bodies and the sun in the axes of a body.

    Args:
        body: Index of the body.
        position: Positions of the bodies, Hill frame [m], shape (N, B, 3).
        sun: Unit vectors to the sun, Hill frame [-], shape (N, 3).
        attitude: Attitudes of the bodies to Hill's frame, shape (N, B, 4); (N, 0, 4) if they are points.
        axes: Data in the axes of the body; its orientation is read, the others are written.
    """
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
        for b in range(attitude.shape[1]):
            relative = product((-x, -y, -z, w), attitude[n, b])
            for k in range(4):
                axes.attitude[n, b, k] = relative[k]


def array_in_axes_of(entity: str, world: World, name: str) -> str:
    """Return the name of the array of ``position``, ``sun_direction`` or ``orientation`` in the axes of a body.

    With an eclipse, the name ``sun_direction`` selects the array ``light_direction``, see `Sun`.

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


class ChiefRotation(PassiveComponent):
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
    offered = {_ORIENTATION: OfView}  # noqa: RUF012 - never written

    def __init__(self, entity: str, world: World) -> None:
        self._entity, self._body = entity, world.bodies[entity]
        bodies, turning = len(world.bodies), "turning_body" in world.offers.world
        self._names = tuple(f"axes/{entity}/{name}" for name in ("position", "sun_direction", "orientation"))
        sizes = ((bodies, 3), (3,), (bodies if turning else 0, 4))
        self.arrays = {_ANGLE: ArraySpec(()), _ORIENTATION: ArraySpec((4,))}
        self.arrays |= {name: ArraySpec(size) for name, size in zip(self._names, sizes, strict=True)}

    def of_world(self) -> Mapping[str, Any]:
        return {"rotating_body": self._entity}

    def shared_state(self, team: Any) -> tuple[Any, ...]:
        return (team.chief_orientation,)

    def _write_in_axes(self, state: State) -> None:
        """Write the bodies and the sun in the axes of the body, whose orientation is known."""
        arrays = state.arrays
        attitude = arrays.get("orientation", np.zeros((state.num_envs, 0, 4)))
        axes = _BodyAxes(arrays[_ORIENTATION], *(arrays[name] for name in self._names))
        _write_in_axes(self._body, state.position, arrays.get(LIGHT, arrays["sun_direction"]), attitude, axes)


class _SteadilyRotating(_Rotating):
    def __init__(self, entity: str, turn: float, axis: Components, world: World) -> None:
        super().__init__(entity, world)
        self._turn, self._axis = turn, axis

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        self._rotate(state, 0.0)

    def step(self, state: State, running: BoolArray) -> None:
        self._rotate(state, self._turn)

    def _rotate(self, state: State, turn: float) -> None:
        _rotate_steadily(turn, self._axis, state[_ANGLE], state[_ORIENTATION])
        self._write_in_axes(state)


class _FreelyRotating(_Rotating):
    def __init__(self, entity: str, free: FreeRotation, world: World) -> None:
        super().__init__(entity, world)
        self._steps, self._mean_motion = free.steps(world.step_size), float(world.mean_motion)
        self._orbit = world.offers.world.get("orbit")
        self.arrays = {**self.arrays, _INERTIAL: ArraySpec((4,)), _SPIN: ArraySpec((3,))}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        _draw_rotations(state["key"], self._steps, state[_INERTIAL], state[_SPIN])
        self._follow(state)

    def step(self, state: State, running: BoolArray) -> None:
        rotate_bodies(self._steps, state[_INERTIAL], state[_SPIN])
        self._follow(state)

    def _follow(self, state: State) -> None:
        if self._orbit is None:
            still = np.zeros(state.num_envs)
            angles = np.stack((still, still, self._mean_motion * state["time"]), axis=1)
        else:
            angles = np.ascontiguousarray(state[self._orbit][:, [5, 3, 4]])  # node, inclination, argument of latitude
        _in_frame(angles, state[_INERTIAL], state[_ORIENTATION])
        self._write_in_axes(state)
