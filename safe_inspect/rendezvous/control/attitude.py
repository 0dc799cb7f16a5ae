"""Attitude control: the command that points the camera and the torque that follows a command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics import quaternion
from safe_inspect.geometry.pointing import R_BC, point_camera
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class AttitudeCommand:
    """An attitude for the controller to follow.

    Attributes:
        orientation: q_WB [x, y, z, w], shape (4,).
        angular_velocity: Angular velocity of the commanded attitude, in its own axes [rad/s], shape (3,).
    """

    orientation: FloatArray
    angular_velocity: FloatArray


class CameraPointing:
    """Generator of attitude commands that point the camera at a target point.

    Each attitude is reached by the shortest arc from the previous one. Its angular velocity is the difference of the
    two attitudes divided by the time step, clipped to what the chaser can follow.
    """

    def __init__(
        self, orientation: FloatArray, largest_rate: float = 0.1745, largest_acceleration: float = 0.1745
    ) -> None:
        """Start from an attitude at rest.

        Args:
            orientation: q_WB at the start, shape (4,).
            largest_rate: Maximum angular rate of a command [rad/s].
            largest_acceleration: Maximum angular acceleration of a command [rad/s^2].
        """
        self.largest_rate, self.largest_acceleration = largest_rate, largest_acceleration
        self._camera = quaternion.to_matrix(np.asarray(orientation)) @ R_BC
        self._last = AttitudeCommand(np.asarray(orientation, dtype=float), np.zeros(3))
        self._first = True

    def step(self, position: FloatArray, target: FloatArray, seconds: float) -> AttitudeCommand:
        """Return the command of this step.

        The angular velocity of the first command is zero because there is no previous attitude.

        Args:
            position: Position of the chaser in W [m], shape (3,).
            target: Point at which the camera is aimed, in W [m], shape (3,).
            seconds: Time since the previous step [s].
        """
        self._camera = point_camera(self._camera, position, target)
        orientation = quaternion.from_matrix(self._camera @ R_BC.T)
        if float(orientation @ self._last.orientation) < 0.0:
            orientation = -orientation
        rate = np.zeros(3)
        if not self._first:
            turn = quaternion.multiply(quaternion.conjugate(self._last.orientation), orientation)
            rate = _clipped(quaternion.log(turn) / seconds, self.largest_rate)
            change = _clipped(rate - self._last.angular_velocity, self.largest_acceleration * seconds)
            rate = self._last.angular_velocity + change
        self._first = False
        self._last = AttitudeCommand(orientation, rate)
        return self._last


@dataclass(frozen=True, eq=False)
class AttitudeController:
    """Proportional-derivative attitude controller that compensates the gyroscopic torque.

    ``tau = -2 K_p sgn(q_e,w) q_e,v - K_d (w - R_e' w_d) + w x J w`` with ``q_e = q_d^-1 q``, ``K_p = J w_n^2`` and
    ``K_d = 2 zeta w_n J``; q and -q give the same torque. Each component is clipped.

    Attributes:
        inertia: Moments of inertia about the axes of the body [kg m^2], shape (3,).
        torque: Maximum torque about each axis [N m].
        frequency: Natural frequency w_n [rad/s].
        damping: Damping ratio zeta. With 0.9 a turn by 60 degrees about any axis takes less than 7 s, with 1 up to
            7.4 s.

    Source:
        Markley and Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control", 2014, section 7.2.
    """

    inertia: FloatArray
    torque: float = 0.025
    frequency: float = 1.0
    damping: float = 0.9

    def __call__(self, orientation: FloatArray, angular_velocity: FloatArray, command: AttitudeCommand) -> FloatArray:
        """Return the torque in B [N m], shape (..., 3).

        Args:
            orientation: q_WB, shape (..., 4).
            angular_velocity: Angular velocity in B [rad/s], shape (..., 3).
            command: The attitude to follow.
        """
        error = quaternion.multiply(quaternion.conjugate(command.orientation), orientation)
        sign = np.where(error[..., 3:] < 0.0, -1.0, 1.0)
        rate = angular_velocity - quaternion.rotate(quaternion.conjugate(error), command.angular_velocity)
        proportional = 2.0 * self.frequency**2 * sign * error[..., :3]
        derivative = 2.0 * self.damping * self.frequency * rate
        gyroscopic = np.cross(angular_velocity, self.inertia * angular_velocity)
        torque = gyroscopic - self.inertia * (proportional + derivative)
        return np.asarray(np.clip(torque, -self.torque, self.torque))


def _clipped(vector: FloatArray, length: float) -> FloatArray:
    """Return a vector, shape (3,), shortened to `length` if it is longer."""
    return vector * min(1.0, length / max(float(np.linalg.norm(vector)), 1e-300))
