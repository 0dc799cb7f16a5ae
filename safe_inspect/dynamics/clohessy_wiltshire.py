"""`ClohessyWiltshire`: a point mass about a circular orbit, with thrust along the axes of Hill's frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, Dynamics, MotionLimits
from safe_inspect.dynamics.cwh import cwh_row, row_state, transition
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAngularRate


@njit(error_model="numpy")
def clohessy_wiltshire_row(
    phi: FloatArray, gamma: FloatArray, position: FloatArray, velocity: FloatArray, control: FloatArray, mass: float
) -> float:
    """Advance one body by the exact map for a held thrust; see `Dynamics`."""
    x, y, z = control[0] / mass, control[1] / mass, control[2] / mass
    after = cwh_row(phi, gamma, row_state(position, velocity), x, y, z)
    for k in range(3):
        position[k] = after[k]
        velocity[k] = after[3 + k]
    rate: float = abs(x) + abs(y) + abs(z)
    return rate


class ClohessyWiltshire(Dynamics):
    """Relative motion about a circular orbit under held thrust, computed with its exact discrete map.

    ``x'' = 3 n^2 x + 2 n y' + u_x/m``, ``y'' = -2 n x' + u_y/m``, ``z'' = -n^2 z + u_z/m``, in Hill's frame. Source:
    Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960.

    Attributes:
        mean_motion: Mean motion n of the chief's orbit [rad/s].
    """

    row: ClassVar[Kernel[..., float]] = clohessy_wiltshire_row

    mean_motion: PositiveAngularRate = 0.001027

    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the transition matrix, shape (6, 6), and the input matrix of a body of 1 kg, shape (6, 3)."""
        return transition(self.mean_motion, 1.0, step_size)

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return no disturbance: the motion is exactly that of the Clohessy-Wiltshire equations."""
        return NO_DISTURBANCE

    def offers(self) -> Mapping[str, Any]:
        """Return the mean motion [rad/s]."""
        return {"mean_motion": self.mean_motion}
