"""Field types of the scripted policies."""

from __future__ import annotations

import math

from safe_inspect.units import quantity

KeepOutAngle = quantity("rad", ge=0, lt=math.pi)
FieldOfView = quantity("rad", gt=0, le=math.pi)
