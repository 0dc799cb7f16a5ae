"""The vehicle of the sample world, which has an attitude and takes a thrust alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import clohessy_wiltshire_row
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.rigid_body import rotation_row
from safe_inspect.types import ArraySpec, FloatArray
from safe_inspect.units import PositiveAngularRate


@njit(error_model="numpy")
def sample_vehicle_row(
    step_size: float,
    phi: FloatArray,
    gamma: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    orientation: FloatArray,
    angular_velocity: FloatArray,
    control: FloatArray,
    mass: float,
) -> float:
    """Advance one body; see `Dynamics`."""
    rate = clohessy_wiltshire_row(phi, gamma, position, velocity, control, mass)
    q, w = orientation, angular_velocity
    for k in range(3):
        w[k] = 0.1 * velocity[k]
    turned = rotation_row((1.0, 1.0, 1.0), (q[0], q[1], q[2], q[3], w[0], w[1], w[2]), (0.0, 0.0, 0.0), step_size)
    for k in range(4):
        q[k] = turned[k]
    return rate


class SampleVehicle(Dynamics):
    """A deputy in Clohessy-Wiltshire dynamics whose angular velocity follows its velocity, so that no two turn alike.

    Attributes:
        mean_motion: Mean motion of the chief's orbit [rad/s].
    """

    row: ClassVar[Kernel[..., float]] = sample_vehicle_row
    arrays: ClassVar[Mapping[str, ArraySpec]] = {
        **Dynamics.arrays,
        "orientation": ArraySpec((4,)),
        "angular_velocity": ArraySpec((3,)),
    }

    mean_motion: PositiveAngularRate = 0.001027

    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the length of the step [s] and the maps of a body of 1 kg."""
        return step_size, *transition(self.mean_motion, 1.0, step_size)

    def initial(self) -> Mapping[str, Sequence[float]]:
        """Return an attitude along Hill's axes."""
        return {"orientation": (0.0, 0.0, 0.0, 1.0)}

    def offers(self) -> Mapping[str, Any]:
        """Return the mean motion [rad/s]."""
        return {"mean_motion": self.mean_motion}
