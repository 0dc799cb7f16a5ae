"""When a point is lit, and from where it is in view, whatever path a plan takes."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.tasks.inspection.points_view import PointsModel
from safe_inspect.types import BoolArray, FloatArray

#: Distance of the two viewers for whom a point must be lit, if the light depends on the viewer [m].
_FAR_AWAY = 1e6


def lit_from_all_sides(model: PointsModel, sun: FloatArray) -> BoolArray:
    """Return the mask of the lit points, shape (T, P).

    A highlight may overexpose a point. Its place differs for a viewer above the orbital plane and for one below, so a
    point only counts as lit if it is lit for both.

    Args:
        model: The points.
        sun: Unit vectors to the sun, shape (T, 3).
    """
    above = np.tile((0.0, 0.0, _FAR_AWAY), (len(sun), 1))
    return np.asarray(model.lit(above, sun) & model.lit(-above, sun))


def sight_range(radius: float, field_of_view: float) -> float:
    """Return the range beyond which a camera that points at the centre has a whole sphere in view [m].

    It is ``radius / sin(field_of_view / 2)``; from there on every point above the horizon is in view.

    Args:
        radius: Radius of the sphere [m].
        field_of_view: Full angle of the camera's cone [rad].
    """
    half = field_of_view / 2.0
    return radius if half >= math.pi / 2.0 else radius / math.sin(half)
