"""`FreeRotation`: torque-free rotation of a body with inspection points in inertial space, drawn at each reset."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, model_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.dynamics.attitude.rigid_body import rotation_row
from safe_inspect.random.splitmix import uniform_at
from safe_inspect.types import AnyArray, FloatArray
from safe_inspect.units import NonNegativeAngularRate, PositiveMomentOfInertia

#: Number of the first sample; other components use those below 8,000.
_FIRST_DRAW = 8_000
#: Largest angle of an integration step [rad].
_LARGEST_TURN = 0.05
_STILL = (0.0, 0.0, 0.0)
#: Components of a quaternion [x, y, z, w].
_Quaternion = tuple[float, float, float, float]


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

    inertia: tuple[PositiveMomentOfInertia, PositiveMomentOfInertia, PositiveMomentOfInertia]
    rate: tuple[NonNegativeAngularRate, NonNegativeAngularRate] = (0.0, 0.0349)  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _possible(self) -> FreeRotation:
        principal_axes(np.diag(self.inertia))  # raises the error if no body has these moments
        if self.rate[0] > self.rate[1]:
            raise ValueError(f"the smallest `rate` {self.rate[0]:g} is above the largest {self.rate[1]:g}; swap them")
        return self

    def steps(self, step_size: float) -> FreeSteps:
        """Return the constants of the integration of a step [s]."""
        # The angular velocity grows at most by the ratio of the moments, since energy and momentum are constant.
        fastest = self.rate[1] * max(self.inertia) / min(self.inertia)
        substeps = max(math.ceil(step_size * fastest / _LARGEST_TURN), 1)
        return FreeSteps(self.inertia, self.rate, step_size / substeps, substeps)


class FreeSteps(NamedTuple):
    """Constants: moments of inertia, range of rates [rad/s], integration step [s] and the number of these in a step."""

    inertia: tuple[float, float, float]
    rate: tuple[float, float]
    step: float
    substeps: int


@njit
def _times(p: _Quaternion, q: _Quaternion) -> _Quaternion:
    """Return the product of two quaternions: first the rotation q, then p."""
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


@njit
def draw_rotations(key: AnyArray, steps: FreeSteps, inertial: FloatArray, spin: FloatArray) -> None:
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
def rotate_freely(steps: FreeSteps, inertial: FloatArray, spin: FloatArray) -> None:
    """Advance attitudes, shape (N, 4), and angular velocities, shape (N, 3), by a step."""
    for n in range(inertial.shape[0]):
        q, w = inertial[n], spin[n]
        x = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
        for _ in range(steps.substeps):
            x = rotation_row(steps.inertia, x, _STILL, steps.step)
        for k in range(4):
            q[k] = x[k]
        for k in range(3):
            w[k] = x[4 + k]


@njit
def in_frame(angles: FloatArray, inertial: FloatArray, orientation: FloatArray) -> None:
    """Write attitudes to Hill's frame, shape (N, 4), for attitudes to inertial axes.

    Args:
        angles: Node, inclination and argument of latitude of Hill's frame in inertial axes [rad], shape (N, 3).
        inertial: Attitudes to inertial axes, shape (N, 4).
        orientation: Output: attitudes to Hill's frame.
    """
    for n in range(inertial.shape[0]):
        node, tilt, latitude = -0.5 * angles[n, 0], -0.5 * angles[n, 1], -0.5 * angles[n, 2]
        q = (inertial[n, 0], inertial[n, 1], inertial[n, 2], inertial[n, 3])
        q = _times((0.0, 0.0, math.sin(node), math.cos(node)), q)
        q = _times((math.sin(tilt), 0.0, 0.0, math.cos(tilt)), q)
        q = _times((0.0, 0.0, math.sin(latitude), math.cos(latitude)), q)
        for k in range(4):
            orientation[n, k] = q[k]


def frame_angles(orbit: FloatArray | None, mean_motion: float, time: FloatArray) -> FloatArray:
    """Return node, inclination and argument of latitude of Hill's frame, shape (N, 3).

    Args:
        orbit: The chief's orbit, see `RelativeOrbit`, shape (N, 6); None on a circular orbit.
        mean_motion: Mean motion of a circular orbit [rad/s].
        time: Time since the reset [s], shape (N,).
    """
    if orbit is not None:
        return np.ascontiguousarray(orbit[:, [5, 3, 4]])
    still = np.zeros_like(time)
    return np.stack((still, still, mean_motion * time), axis=1)
