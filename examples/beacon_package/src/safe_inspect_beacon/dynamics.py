"""A vehicle: a double integrator with linear drag."""

import math
from typing import ClassVar

from pydantic import Field

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics import Dynamics


@njit
def drag_row(decay, reach, position_gain, velocity_gain, position, velocity, control, mass):
    """Advance one body by the exact map under a held force; return the velocity change that it spends in a second."""
    spent = 0.0
    for k in range(3):
        acceleration = control[k] / mass
        position[k] += reach * velocity[k] + position_gain * acceleration
        velocity[k] = decay * velocity[k] + velocity_gain * acceleration
        spent += abs(acceleration)
    return spent


class DragPointMass(Dynamics):
    """x'' = u / m - k x', by its exact discrete map under held forces.

    Attributes:
        drag: Rate k at which the velocity decays [1/s].
    """

    row: ClassVar[Kernel] = drag_row

    drag: float = Field(default=0.01, gt=0)

    def __call__(self, step_size):
        """Return exp(-k t), (1 - exp(-k t)) / k, and the gains of an acceleration on position and velocity."""
        decay = math.exp(-self.drag * step_size)
        reach = -math.expm1(-self.drag * step_size) / self.drag
        return decay, reach, (step_size - reach) / self.drag, reach
