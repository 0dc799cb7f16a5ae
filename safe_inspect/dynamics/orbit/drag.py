"""`Drag`: parameters of the drag of a deputy and the chief in an exponential atmosphere."""

from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict

from safe_inspect.units import NonNegativeAreaPerMass, NonNegativeDensity, PositiveLength


class Drag(BaseModel):
    """Drag of spheres in an exponential atmosphere that is at rest in inertial space.

    Attributes:
        density: Density at the height of the semi-major axis [kg/m^3]; the default is that of 850 km, the height of the
            default mean motion, at high solar activity.
        scale_height: Height over which the density falls by a factor e [m].
        deputy: Drag coefficient times area over mass of a deputy, C_D A / m [m^2/kg].
        chief: The same of the chief [m^2/kg].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    density: NonNegativeDensity = 1e-13  # type: ignore[valid-type]
    scale_height: PositiveLength = 125e3
    deputy: NonNegativeAreaPerMass = 0.02  # type: ignore[valid-type]
    chief: NonNegativeAreaPerMass = 0.01  # type: ignore[valid-type]

    def difference(self, below: float, speed: float, nearer: float, faster: float) -> float:
        """Return a bound of the difference of a deputy's and the chief's accelerations [m/s^2].

        Args:
            below: Largest height of the chief below the semi-major axis [m].
            speed: Its largest speed in inertial space [m/s].
            nearer: Largest distance between deputy and chief [m].
            faster: Largest difference of their speeds in inertial space [m/s].
        """
        pressure = 0.5 * self.density * math.exp(below / self.scale_height) * speed**2
        more = math.exp(nearer / self.scale_height) * (1.0 + faster / speed) ** 2 - 1.0
        return float(pressure * (abs(self.deputy - self.chief) + self.deputy * more))
