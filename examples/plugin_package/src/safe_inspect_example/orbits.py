"""An orbit: linear relative motion that includes the mean effect of the Earth's oblateness."""

import math
from typing import ClassVar

import numpy as np
from scipy.linalg import expm

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics import Dynamics
from safe_inspect.units import PolarAngle, PositiveAngularRate


@njit
def linear_row(phi, gamma, position, velocity, control, mass):
    """Advance one body by x = phi x + gamma u / mass; return the velocity change that it spends in a second."""
    x, u = np.concatenate((position, velocity)), control / mass
    for k in range(3):
        position[k], velocity[k] = phi[k] @ x + gamma[k] @ u, phi[3 + k] @ x + gamma[3 + k] @ u
    return np.abs(u).sum()


class SchweighartSedwick(Dynamics):
    """x'' = 2 n c y' + (5 c^2 - 2) n^2 x, y'' = -2 n c x', z'' = -(3 c^2 - 2) n^2 z, in Hill's frame, plus u / m.

    Schweighart and Sedwick, J. Guidance, Control, and Dynamics 25(6), 2002, without the forcing across the orbit.

    Attributes:
        mean_motion: Mean motion n of the chief's orbit [rad/s].
        inclination: Inclination of the orbit [rad].
    """

    row: ClassVar[Kernel] = linear_row
    mean_motion: PositiveAngularRate = 0.001027
    inclination: PolarAngle = 0.9

    def __call__(self, step_size):
        """Return the transition matrix of a step, shape (6, 6), and the gain of an acceleration, shape (6, 3)."""
        n, radius = self.mean_motion, (3.986004418e14 / self.mean_motion**2) ** (1.0 / 3.0)
        s = 3.0 * 1.0826e-3 / 8.0 * (6.378e6 / radius) ** 2 * (1.0 + 3.0 * math.cos(2.0 * self.inclination))
        c = math.sqrt(1.0 + s)
        a = np.zeros((9, 9))
        a[:3, 3:6] = a[3:6, 6:] = np.eye(3)
        a[3, 0], a[3, 4], a[4, 3], a[5, 2] = (5 * c * c - 2) * n * n, 2 * n * c, -2 * n * c, -(3 * c * c - 2) * n * n
        map_of_step = expm(a * step_size)
        return np.ascontiguousarray(map_of_step[:6, :6]), np.ascontiguousarray(map_of_step[:6, 6:])

    def offers(self):
        """Return the mean motion [rad/s], which sensors and the sun need."""
        return {"mean_motion": self.mean_motion}
