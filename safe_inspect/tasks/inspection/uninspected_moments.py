"""Moments of the directions of the points that are not inspected, lit and dark, compiled, row by row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.geometry.visibility import Surface, light_row, point_axes
from safe_inspect.types import FloatArray

#: Length of the moments of one kind of points: fraction, mean direction, and second moment (xx, yy, zz, xy, xz, yz).
OF_A_KIND = 10
#: Length of the moments of both kinds.
MOMENTS = 2 * OF_A_KIND


@njit
def _within_unit(value: float) -> float:
    return min(max(value, -1.0), 1.0)


@njit
def uninspected_moments(
    size: int, sun: FloatArray, surface: Surface, inspector: NDArray[np.int8], moments: FloatArray
) -> None:
    """Write the moments of the points that no deputy has inspected, lit and dark, for each deputy of a group.

    Args:
        size: Number of deputies of the group, G; R = N * G rows.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        inspector: Index of the deputy that inspected each point, -1 for none, shape (N, P).
        moments: Receives, for the lit points and then for the dark ones: their number over P, the mean of their unit
            vectors, and the mean of the products xx, yy, zz, xy, xz, yz; zeros if there are none; shape (R, 20).
    """
    total = surface.points.shape[0]
    axes, bright = point_axes(surface.points), np.empty(total, dtype=np.bool_)
    for n in range(sun.shape[0]):
        light_row(sun[n], axes, surface.terminator, bright)
        for g in range(size):
            sums = moments[n * size + g]
            sums[:] = 0.0
            for p in range(total):
                if inspector[n, p] >= 0:
                    continue
                at = 0 if bright[p] else OF_A_KIND
                x, y, z = axes[0, p] / surface.radius, axes[1, p] / surface.radius, axes[2, p] / surface.radius
                sums[at] += 1.0
                sums[at + 1] += x
                sums[at + 2] += y
                sums[at + 3] += z
                sums[at + 4] += x * x
                sums[at + 5] += y * y
                sums[at + 6] += z * z
                sums[at + 7] += x * y
                sums[at + 8] += x * z
                sums[at + 9] += y * z
            for at in (0, OF_A_KIND):
                count = sums[at]
                if count > 0.0:
                    sums[at] = count / total
                    for k in range(1, OF_A_KIND):
                        sums[at + k] = _within_unit(sums[at + k] / count)


@njit
def turn_moments(orientation: FloatArray, moments: FloatArray, turned: FloatArray) -> None:
    """Write moments in Hill's frame: ``R m`` of the means, ``R M R^T`` of the second moments.

    Args:
        orientation: Attitude of the body, from its axes to Hill's frame, shape (4,).
        moments: Moments in the axes of the body, see `uninspected_moments`, shape (20,).
        turned: Receives the moments in Hill's frame, shape (20,).
    """
    for at in (0, OF_A_KIND):
        m = moments[at : at + OF_A_KIND]
        turned[at] = m[0]
        mean = rotated(orientation, m[1], m[2], m[3])
        # The columns of R M; its rows, rotated again, are those of R M R^T.
        x = rotated(orientation, m[4], m[7], m[8])
        y = rotated(orientation, m[7], m[5], m[9])
        z = rotated(orientation, m[8], m[9], m[6])
        first = rotated(orientation, x[0], y[0], z[0])
        second = rotated(orientation, x[1], y[1], z[1])
        third = rotated(orientation, x[2], y[2], z[2])
        found = (mean[0], mean[1], mean[2], first[0], second[1], third[2], first[1], first[2], second[2])
        for k in range(9):
            turned[at + 1 + k] = _within_unit(found[k])
