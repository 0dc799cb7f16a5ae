"""What a plan may count on seeing: the light on the points, and the range at which the camera holds the body."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.tasks.inspection.points_model import PointsModel
from safe_inspect.types import BoolArray, FloatArray

#: Distance of the viewers for whom a point has to be lit where the light depends on the viewer [m].
_FAR_AWAY = 1e6


def lit_from_all_sides(model: PointsModel, sun: FloatArray) -> BoolArray:
    """Return which points are lit, shape (T, P).

    A highlight may wash a point out; it lies elsewhere for a viewer above the orbit's plane and for one below, so a
    point counts as lit when it is for both.

    Args:
        model: The points.
        sun: Unit vectors to the sun, shape (T, 3).
    """
    above = np.tile((0.0, 0.0, _FAR_AWAY), (len(sun), 1))
    return np.asarray(model.lit(above, sun) & model.lit(-above, sun))


def sight_range(radius: float, field_of_view: float) -> float:
    """Return the range from which a camera that points at the centre holds a whole sphere [m].

    ``radius / sin(field_of_view / 2)``; from there on every point above the horizon is in view.

    Args:
        radius: Radius of the sphere [m].
        field_of_view: Full angle of the camera's cone [rad].
    """
    half = field_of_view / 2.0
    return radius if half >= math.pi / 2.0 else radius / math.sin(half)
