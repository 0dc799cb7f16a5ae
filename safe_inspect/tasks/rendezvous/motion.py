"""Compiled motion of a tumbling target and clearance of chasers from it."""

from __future__ import annotations

from typing import NamedTuple

from safe_inspect.compiling import njit
from safe_inspect.dynamics.attitude.rigid_body import rotation_row
from safe_inspect.dynamics.rotation_row import rotated, rotated_back
from safe_inspect.geometry.oriented_boxes import BoxArrays, box_distance
from safe_inspect.types import FloatArray


class TargetBody(NamedTuple):
    """Rigid body in its principal axes T.

    Attributes:
        inertia: Principal moments, up to a factor, shape (3,).
        mating_point: Position of the chaser's centre when docked [m], shape (3,).
        boxes: Shape of the body.
    """

    inertia: FloatArray
    mating_point: FloatArray
    boxes: BoxArrays


class TargetArrays(NamedTuple):
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
def follow_target(body: TargetBody, dt: float, steps: int, arrays: TargetArrays, chasers: FloatArray) -> None:
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
        x = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
        for _ in range(steps):
            x = rotation_row(j, x, (0.0, 0.0, 0.0), dt)
        for i in range(4):
            q[i] = x[i]
        for i in range(3):
            w[i] = x[4 + i]
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
