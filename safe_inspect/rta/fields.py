"""Field types of the constraints and their parameters, with their SI units, in addition to `safe_inspect.units`."""

from __future__ import annotations

import math

from safe_inspect.units import quantity

PositiveAcceleration = quantity("m/s^2", gt=0)
#: Slope of a speed over a range, (m/s)/m.
SpeedSlope = quantity("Hz", ge=0)
#: Full opening angle; a cone of half a turn or more would cover the whole half space.
ConeAngle = quantity("rad", gt=0, lt=math.pi)
