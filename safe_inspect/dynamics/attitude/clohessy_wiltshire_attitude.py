"""`ClohessyWiltshireAttitude`: a rigid body about a circular orbit, with thrusters and reaction wheels.

Position and attitude move together under held forces and moments:

    p'' = CWH(p, p') + R(q) F / m,        q' = q [w, 0] / 2 - n [0, 0, 1, 0] q / 2,        J w' = M - w x J w

where q is the attitude from body to Hill's frame and w the body's angular velocity relative to inertial space, in body
axes. The second term of q' is the rotation of Hill's frame at the rate n. Each component of w' is limited. Each
component of w is limited too: where it would exceed its limit, its derivative is 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics.attitude.inertia import PrincipalMoments
from safe_inspect.dynamics.attitude.rigid_body import (
    RotationState,
    Vector,
    moved_rotation,
    moved_vector,
    rotation_rates,
)
from safe_inspect.dynamics.base import TURNING_ARRAYS, Dynamics
from safe_inspect.dynamics.cwh import cwh_row, row_state, transition
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.types import ArraySpec, FloatArray
from safe_inspect.units import PositiveAngularAcceleration, PositiveAngularRate

#: Attitude and angular velocity, position and velocity.
CoupledState = tuple[RotationState, Vector, Vector]
#: For each axis, 1 or -1 if the angular velocity is held at its upper or lower limit, else 0.
Held = tuple[int, int, int]

#: Relative excess of an angular velocity over its limit that is attributed to rounding.
_ROUNDING = 1e-13
#: Largest number of attempts to end a step where an axis reaches its limit.
_TRIES = 12


class _TurningBody(NamedTuple):
    """Constants of a body that turns.

    Attributes:
        mean_motion: Mean motion of the chief's orbit [rad/s].
        frame_rate: Rate at which Hill's frame turns about its z axis in the equation of the attitude [rad/s].
        inertia: Principal moments of inertia [kg m^2].
        rate_limit: Largest magnitude of each component of the angular velocity [rad/s].
        acceleration_limit: Largest magnitude of each component of its derivative [rad/s^2].
        in_body_axes: Whether the force is given in body axes; else it is in Hill's frame.
        step_size: Length of a step [s].
        substeps: Integration steps per step, if no axis reaches its limit.
    """

    mean_motion: float
    frame_rate: float
    inertia: Vector
    rate_limit: float
    acceleration_limit: float
    in_body_axes: bool
    step_size: float
    substeps: int


@njit(error_model="numpy")
def _within(rate: float, limit: float, held: int) -> float:
    """Return the derivative of an angular velocity, limited, and without an outward part if the velocity is held."""
    rate = min(max(rate, -limit), limit)
    if (held > 0 and rate > 0.0) or (held < 0 and rate < 0.0):
        return 0.0
    return rate


@njit(error_model="numpy")
def _turning_rates(body: _TurningBody, x: RotationState, moment: Vector, held: Held) -> RotationState:
    """Return the time derivatives of the attitude [1/s] and the angular velocity [rad/s^2].

    Args:
        body: The body.
        x: Attitude from body to Hill's frame, and angular velocity in body axes.
        moment: Moment in body axes [N m].
        held: Axes whose angular velocity is at a limit.
    """
    rates = rotation_rates(body.inertia, x, moment)
    half, limit = 0.5 * body.frame_rate, body.acceleration_limit
    return (
        rates[0] + half * x[1],
        rates[1] - half * x[0],
        rates[2] - half * x[3],
        rates[3] + half * x[2],
        _within(rates[4], limit, held[0]),
        _within(rates[5], limit, held[1]),
        _within(rates[6], limit, held[2]),
    )


@njit(error_model="numpy")
def _acceleration(body: _TurningBody, x: CoupledState, force: Vector) -> Vector:
    """Return the acceleration in Hill's frame under a force per kilogram [m/s^2]."""
    q, p, v = x
    fx, fy, fz = force
    if body.in_body_axes:
        fx, fy, fz = rotated((q[0], q[1], q[2], q[3]), fx, fy, fz)
    n = body.mean_motion
    return 3.0 * n * n * p[0] + 2.0 * n * v[1] + fx, -2.0 * n * v[0] + fy, -n * n * p[2] + fz


@njit(error_model="numpy")
def _stage(body: _TurningBody, x: CoupledState, force: Vector, moment: Vector, held: Held) -> CoupledState:
    """Return the time derivatives of the whole state."""
    return _turning_rates(body, x[0], moment, held), x[2], _acceleration(body, x, force)


@njit(error_model="numpy")
def _moved(x: CoupledState, rate: CoupledState, dt: float) -> CoupledState:
    return moved_rotation(x[0], rate[0], dt), moved_vector(x[1], rate[1], dt), moved_vector(x[2], rate[2], dt)


@njit(error_model="numpy")
def _substep(
    body: _TurningBody, x: CoupledState, force: Vector, moment: Vector, held: Held, dt: float
) -> CoupledState:  # fmt: skip
    """Return the state after one step of the classical Runge-Kutta method; the attitude is not normalised."""
    k1 = _stage(body, x, force, moment, held)
    k2 = _stage(body, _moved(x, k1, 0.5 * dt), force, moment, held)
    k3 = _stage(body, _moved(x, k2, 0.5 * dt), force, moment, held)
    k4 = _stage(body, _moved(x, k3, dt), force, moment, held)
    return _moved(_moved(_moved(_moved(x, k1, dt / 6.0), k2, dt / 3.0), k3, dt / 3.0), k4, dt / 6.0)


@njit(error_model="numpy")
def _side(rate: float, limit: float) -> int:
    """Return the limit that an angular velocity has reached: 1, -1, or 0 for neither."""
    return 1 if rate >= limit else -1 if rate <= -limit else 0


@njit(error_model="numpy")
def _share(before: float, after: float, limit: float, held: int) -> float:
    """Return the fraction of a step after which an angular velocity reaches its limit, by linear interpolation.

    The result is 1 if the limit is not exceeded, or the angular velocity is already held there.
    """
    if held != 0 or abs(after) <= limit * (1.0 + _ROUNDING):
        return 1.0
    return (math.copysign(limit, after) - before) / (after - before)


@njit(error_model="numpy")
def _tidied(x: CoupledState, limit: float) -> CoupledState:
    """Return the state with a unit quaternion, and with angular velocities within their limit."""
    q = x[0]
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    near = limit * (1.0 - _ROUNDING)
    wx = math.copysign(limit, q[4]) if abs(q[4]) >= near else q[4]
    wy = math.copysign(limit, q[5]) if abs(q[5]) >= near else q[5]
    wz = math.copysign(limit, q[6]) if abs(q[6]) >= near else q[6]
    return (scale * q[0], scale * q[1], scale * q[2], scale * q[3], wx, wy, wz), x[1], x[2]


@njit(error_model="numpy")
def _coupled_step(body: _TurningBody, x: CoupledState, force: Vector, moment: Vector) -> CoupledState:
    """Return the state after a step in which force and moment are held.

    The steps of the classical Runge-Kutta method end where an axis reaches its limit. The time at which it does is
    found by linear interpolation, which is exact if the moment alone accelerates the axis, and is repeated otherwise.

    Args:
        body: The body.
        x: The state.
        force: Force per kilogram [m/s^2].
        moment: Moment in body axes [N m].
    """
    x = _tidied(x, body.rate_limit)
    limit, whole = body.rate_limit, body.step_size / body.substeps
    left, wanted, tries = body.step_size, whole, 0
    while left > 1e-12 * body.step_size:
        q = x[0]
        held = (_side(q[4], limit), _side(q[5], limit), _side(q[6], limit))
        dt = min(wanted, left)
        y = _substep(body, x, force, moment, held, dt)
        share = min(
            _share(q[4], y[0][4], limit, held[0]),
            _share(q[5], y[0][5], limit, held[1]),
            _share(q[6], y[0][6], limit, held[2]),
        )
        if share < 1.0 and tries < _TRIES:
            wanted, tries = dt * share, tries + 1
        else:
            x, left, wanted, tries = _tidied(y, limit), left - dt, whole, 0
    return x


@njit(error_model="numpy")
def rests(body: _TurningBody, x: RotationState, moment: Vector) -> bool:
    """Return whether the attitude and the angular velocity do not change."""
    rates = _turning_rates(body, x, moment, (0, 0, 0))
    moves = 0.0
    for rate in rates:
        moves = max(moves, abs(rate))
    return moves == 0.0


@njit(error_model="numpy")
def _vector_of(array: FloatArray, start: int) -> Vector:
    """Return three numbers of an array."""
    return array[start], array[start + 1], array[start + 2]


@njit(error_model="numpy")
def _clohessy_wiltshire_attitude_row(
    body: _TurningBody,
    phi: FloatArray,
    gamma: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    orientation: FloatArray,
    angular_velocity: FloatArray,
    control: FloatArray,
    mass: float,
) -> float:
    """Advance one body; see `Dynamics`. Without thrust its position follows the exact map."""
    force, moment = _vector_of(control, 0), _vector_of(control, 3)
    rate: float = (abs(force[0]) + abs(force[1]) + abs(force[2])) / mass
    q, w = orientation, angular_velocity
    turning = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
    p, v = _vector_of(position, 0), _vector_of(velocity, 0)
    if rate == 0.0:
        coasted = cwh_row(phi, gamma, row_state(position, velocity), 0.0, 0.0, 0.0)
        for k in range(3):
            position[k], velocity[k] = coasted[k], coasted[3 + k]
        if rests(body, turning, moment):
            return rate
    shares = (force[0] / mass, force[1] / mass, force[2] / mass)
    after = _coupled_step(body, (turning, p, v), shares, moment)
    for k in range(4):
        orientation[k] = after[0][k]
    for k in range(3):
        angular_velocity[k] = after[0][4 + k]
        if rate > 0.0:
            position[k], velocity[k] = after[1][k], after[2][k]
    return rate


class ClohessyWiltshireAttitude(Dynamics):
    """Relative motion about a circular orbit, and attitude, under held forces and moments.

    ``p'' = CWH(p, p') + R(q) F / m``, ``q' = q [w_r, 0] / 2``, ``J w' = M - w x J w``: q is the attitude from body to
    Hill's frame, scalar last, and w the angular velocity in body axes; ``w_r = w - R(q)^T [0, 0, n]`` is the angular
    velocity relative to Hill's frame. The control is F in newtons, then M in newton metres, both along body axes.
    Position and attitude are integrated together with the classical Runge-Kutta method, in steps that end where a
    component of w reaches its limit. Source: Clohessy and Wiltshire, "Terminal guidance system for satellite
    rendezvous", 1960; Markley and Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control", Springer
    2014, chapter 3.

    Attributes:
        mean_motion: Mean motion n of the chief's orbit [rad/s].
        inertia: Principal moments of inertia J [kg m^2].
        rate_limit: Largest magnitude of each component of w [rad/s]; None: no limit.
        acceleration_limit: Largest magnitude of each component of w' [rad/s^2]; None: no limit.
        body_frame_thrust: True: F turns with the body. False: F is given in Hill's frame.
        rate_against: ``inertial``: w is relative to inertial space, as measured by a gyroscope. ``hill``: w is relative
            to Hill's frame, w_r = w, as in safe-autonomy-simulation up to version 2.1.4.
        substeps: Integration steps in a physics step, plus one for each limit that is reached in it.
    """

    row: ClassVar[Kernel[..., float]] = _clohessy_wiltshire_attitude_row
    arrays: ClassVar[Mapping[str, ArraySpec]] = TURNING_ARRAYS
    control_size: ClassVar[int] = 6
    control_unit: ClassVar[str] = "N and N m"

    mean_motion: PositiveAngularRate = 0.001027
    inertia: PrincipalMoments = (0.0573, 0.0573, 0.0573)
    rate_limit: PositiveAngularRate | None = 0.034907
    acceleration_limit: PositiveAngularAcceleration | None = 0.017453
    body_frame_thrust: bool = True
    rate_against: Literal["inertial", "hill"] = "inertial"
    substeps: int = Field(default=8, ge=1)

    @property
    def turns_thrust(self) -> bool:
        """Whether the thrust turns with the body."""
        return self.body_frame_thrust

    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the body, the transition matrix, shape (6, 6), and the input matrix for 1 kg, shape (6, 3)."""
        rate, acceleration = (x if x is not None else math.inf for x in (self.rate_limit, self.acceleration_limit))
        motion = (self.mean_motion, self.frame_rate, self.inertia, rate, acceleration)
        body = _TurningBody(*motion, self.body_frame_thrust, step_size, self.substeps)
        return body, *transition(self.mean_motion, 1.0, step_size)

    def initial(self) -> Mapping[str, Sequence[float]]:
        """Return attitude and angular velocity of a body that is aligned with Hill's frame and does not turn in it."""
        return {"orientation": (0.0, 0.0, 0.0, 1.0), "angular_velocity": (0.0, 0.0, self.frame_rate)}

    def offers(self) -> Mapping[str, Any]:
        """Return the mean motion [rad/s], and these dynamics, which define the attitude motion, as ``turning_body``."""
        return {"mean_motion": self.mean_motion, "turning_body": self}

    @property
    def frame_rate(self) -> float:
        """Rate about z of Hill's frame relative to the reference of the angular velocity [rad/s]."""
        return self.mean_motion if self.rate_against == "inertial" else 0.0
