"""Paths of an approach, which planners return and from which plans are certified and sampled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from safe_inspect.types import FloatArray


class ApproachPath(Protocol):
    """A path of the chaser relative to the target's centre of mass, along the axes of W, for times in [0, duration].

    The velocity must be continuous. The two bounds must hold at all times: the certificate uses them between
    the times at which it evaluates the path.
    """

    @property
    def duration(self) -> float:
        """Duration of the approach [s]."""

    @property
    def largest_speed(self) -> float:
        """Upper bound of the speed [m/s]."""

    @property
    def largest_distance(self) -> float:
        """Upper bound of the distance from the target's centre of mass [m]."""

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position [m], velocity [m/s] and acceleration [m/s^2] at times since the start [s], (K, 3) each."""


@dataclass(frozen=True, eq=False)
class SampledPath:
    """A path through samples of position and velocity, with a cubic polynomial between each two consecutive samples.

    On a segment of length h the polynomial has the Bezier points ``p0, p0 + h v0 / 3, p1 - h v1 / 3, p1``. The
    polynomial stays in the convex hull of these points, and its derivative in the convex hull of three times their
    differences over h, which gives the bounds. Source: Farin, "Curves and Surfaces for CAGD", 2002.

    Attributes:
        times: Times of the samples since the start, ascending from 0 [s], shape (K,).
        position: Position relative to the target's centre of mass, along the axes of W [m], shape (K, 3).
        velocity: Derivative of the position [m/s], shape (K, 3).
    """

    times: FloatArray
    position: FloatArray
    velocity: FloatArray

    def __post_init__(self) -> None:
        """Check the samples.

        Raises:
            ValueError: The times do not ascend from 0, or an array is not finite or has another shape.
        """
        for name in ("times", "position", "velocity"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        count = len(self.times)
        if self.times.shape != (count,) or count < 2 or self.times[0] != 0.0 or not (np.diff(self.times) > 0.0).all():
            raise ValueError("path: expected at least two samples whose times start at 0 s and increase")
        for name in ("position", "velocity"):
            value = getattr(self, name)
            if value.shape != (count, 3) or not np.isfinite(value).all():
                raise ValueError(f"path: {name} must be finite, of shape {(count, 3)}, got the shape {value.shape}")

    @property
    def duration(self) -> float:
        """Duration of the approach [s]."""
        return float(self.times[-1])

    @cached_property
    def largest_speed(self) -> float:
        """Upper bound of the speed [m/s]."""
        step = np.diff(self.times)[:, None, None]
        return float(np.linalg.norm(3.0 * np.diff(self._points, axis=1) / step, axis=2).max())

    @cached_property
    def largest_distance(self) -> float:
        """Upper bound of the distance from the target's centre of mass [m]."""
        return float(np.linalg.norm(self._points, axis=2).max())

    @cached_property
    def _points(self) -> FloatArray:
        """The Bezier points of each segment [m], shape (K - 1, 4, 3)."""
        p, reach = self.position, np.diff(self.times)[:, None] * self.velocity[:-1] / 3.0
        back = np.diff(self.times)[:, None] * self.velocity[1:] / 3.0
        return np.stack((p[:-1], p[:-1] + reach, p[1:] - back, p[1:]), axis=1)

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position [m], velocity [m/s] and acceleration [m/s^2] at times since the start [s], (K, 3) each."""
        from scipy.interpolate import CubicHermiteSpline  # This import is slow.

        spline = CubicHermiteSpline(self.times, self.position, self.velocity)
        return spline(times), spline(times, 1), spline(times, 2)
