"""`DoubleIntegrator`: a point mass in free space, with thrust along fixed axes."""

from __future__ import annotations

from typing import Any, ClassVar

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.types import FloatArray


@njit(error_model="numpy")
def double_integrator_row(
    step_size: float, position: FloatArray, velocity: FloatArray, control: FloatArray, mass: float
) -> float:
    """Advance one body by the exact map for a held thrust; see `Dynamics`."""
    rate = 0.0
    for k in range(3):
        acceleration = control[k] / mass
        position[k] += step_size * velocity[k] + 0.5 * step_size * step_size * acceleration
        velocity[k] += step_size * acceleration
        rate += abs(acceleration)
    return rate


class DoubleIntegrator(Dynamics):
    """A point mass in free space under held thrust, ``p'' = u / m``, by its exact discrete map; inertial axes.

    There is no orbit and no mean motion, so safety filters for Clohessy-Wiltshire dynamics are rejected.
    """

    row: ClassVar[Kernel[..., float]] = double_integrator_row

    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the length of the step [s]."""
        return (step_size,)
