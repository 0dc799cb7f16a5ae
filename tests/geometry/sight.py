"""What one viewer sees of a sphere, by the kernel that inspects."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.geometry.visibility import Credit, Scores, Surface, inspect_body


def visible(
    viewer: np.ndarray, points: np.ndarray, radius: float, cos_half_fov: float, terminator: float = -math.inf
) -> np.ndarray:
    """Return which points each viewer, shape (R, 3), is credited with if it is alone, shape (R, P).

    By default every point is lit; the sun is towards -z.
    """
    rows, count = len(viewer), len(points)
    credit = Credit(np.full((rows, count), -1, np.int8), np.zeros(rows, np.int64), np.zeros((rows, 1), np.int64))
    scores = Scores(np.ones((rows, count)), np.zeros(rows), np.zeros((rows, 1)))
    position = np.stack((viewer, np.zeros_like(viewer)), axis=1)
    surface = Surface(np.ascontiguousarray(points), radius, terminator)
    active, sun = np.ones((rows, 1), np.bool_), np.tile([0.0, 0.0, -1.0], (rows, 1))
    inspect_body(position, 1, sun, surface, cos_half_fov, active, credit, scores)
    seen = credit.inspector == 0
    np.testing.assert_array_equal(credit.team_count, seen.sum(axis=1))
    np.testing.assert_array_equal(credit.own_count[:, 0], credit.team_count)
    return seen
