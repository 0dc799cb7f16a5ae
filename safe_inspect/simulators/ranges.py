"""The distance that rewards and dones share."""

from __future__ import annotations

import numpy as np

from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray


def range_to(view: View, position_sensor: str | None) -> FloatArray:
    """Return the distance to what a sensor locates [m], shape (R,); to the origin of Hill's frame for None."""
    offset = view.position if position_sensor is None else view.position - view.reading(position_sensor)
    return np.sqrt(np.square(offset).sum(axis=-1))
