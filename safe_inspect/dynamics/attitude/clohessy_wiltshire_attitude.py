"""`ClohessyWiltshireAttitude`: a rigid body about a circular orbit, with thrusters and reaction wheels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics.attitude.coupled_row import TurningBody, coupled_step, rests, vector_of
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.cwh_row import cwh_row
from safe_inspect.types import ArraySpec, FloatArray
from safe_inspect.units import PositiveAngularAcceleration, PositiveAngularRate, PositiveMomentOfInertia


@njit(error_model="numpy")
def clohessy_wiltshire_attitude_row(
    body: TurningBody,
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
    force, moment = vector_of(control, 0), vector_of(control, 3)
    rate: float = (abs(force[0]) + abs(force[1]) + abs(force[2])) / mass
    q, w = orientation, angular_velocity
    turning = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
    p, v = vector_of(position, 0), vector_of(velocity, 0)
    if rate == 0.0:
        coasted = cwh_row(phi, gamma, (p[0], p[1], p[2], v[0], v[1], v[2]), 0.0, 0.0, 0.0)
        for k in range(3):
            position[k], velocity[k] = coasted[k], coasted[3 + k]
        if rests(body, turning, moment):
            return rate
    shares = (force[0] / mass, force[1] / mass, force[2] / mass)
    after = coupled_step(body, (turning, p, v), shares, moment)
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

    row: ClassVar[Kernel[..., float]] = clohessy_wiltshire_attitude_row
    arrays: ClassVar[Mapping[str, ArraySpec]] = {
        **Dynamics.arrays,
        "orientation": ArraySpec((4,)),
        "angular_velocity": ArraySpec((3,)),
    }
    control_size: ClassVar[int] = 6
    control_unit: ClassVar[str] = "N and N m"

    mean_motion: PositiveAngularRate = 0.001027
    inertia: tuple[PositiveMomentOfInertia, PositiveMomentOfInertia, PositiveMomentOfInertia] = (0.0573, 0.0573, 0.0573)
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
        body = TurningBody(
            self.mean_motion,
            self.frame_rate,
            self.inertia,
            math.inf if self.rate_limit is None else self.rate_limit,
            math.inf if self.acceleration_limit is None else self.acceleration_limit,
            self.body_frame_thrust,
            step_size,
            self.substeps,
        )
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
