"""Points spread evenly over a sphere, body-fixed to the chief."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from safe_inspect.types import FloatArray

_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def sphere_points(algorithm: Literal["fibonacci", "cmu"], num_points: int, radius: float) -> FloatArray:
    """Return points spread evenly over a sphere about the origin.

    Args:
        algorithm: ``fibonacci`` (exactly `num_points`) or ``cmu`` (rings; nearly `num_points`: 99 for 100).
        num_points: Requested number of points.
        radius: Radius of the sphere [m].

    Returns:
        Positions [m], shape (P, 3), from +z to -z.
    """
    return radius * (_fibonacci if algorithm == "fibonacci" else _cmu)(num_points)


def _fibonacci(count: int) -> FloatArray:
    """Return the spherical Fibonacci lattice of the unit sphere, shape (count, 3).

    Point i is at the height z = 1 - (2 i + 1)/count, the middle of the i-th of `count` slices of equal height and
    therefore of equal area, at an azimuth of i golden angles.

    Source:
        Swinbank and Purser, "Fibonacci grids: a novel approach to global modelling", 2006.
    """
    i = np.arange(count, dtype=np.float64)
    height = 1.0 - (2.0 * i + 1.0) / count
    return _on_unit_sphere(height, np.sqrt((1.0 - height) * (1.0 + height)), i * _GOLDEN_ANGLE)


def _cmu(count: int) -> FloatArray:
    """Return rings of points of the unit sphere, each point with nearly the same area, shape (P, 3).

    The share of the sphere of each point, 4 pi/count, is treated as a square. Rings of latitude are about one side of
    the square apart, in the middles of equal intervals of the polar angle. The spacing of the points of a ring follows
    from the share of area, and the first point of each ring is at azimuth 0. P may differ from `count` because the
    numbers of rings and of points per ring are rounded to whole numbers.

    Source:
        Deserno, "How to generate equidistributed points on the surface of a sphere", 2004.
    """
    area = 4.0 * math.pi / count
    rings = round(math.pi / math.sqrt(area))
    spacing = math.pi / rings
    polar, azimuth = [], []
    for ring in range(rings):
        angle = (ring + 0.5) * spacing
        size = round(2.0 * math.pi * math.sin(angle) * spacing / area)
        polar.append(np.full(size, angle))
        azimuth.append(2.0 * math.pi * np.arange(size) / size)
    angles = np.concatenate(polar)
    return _on_unit_sphere(np.cos(angles), np.sin(angles), np.concatenate(azimuth))


def _on_unit_sphere(height: FloatArray, distance: FloatArray, azimuth: FloatArray) -> FloatArray:
    """Return points from their heights, their distances from the z axis and their azimuths."""
    return np.stack((distance * np.cos(azimuth), distance * np.sin(azimuth), height), axis=-1)
