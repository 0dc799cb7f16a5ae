"""Paths of an approach: their interface, cubic polynomials through samples, and clamped B-splines of degree 5."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from safe_inspect.types import FloatArray

DEGREE = 5
#: Number of control points at each end that are determined by the position, velocity and acceleration there.
FIXED = 3


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


@dataclass(frozen=True, eq=False)
class SplineBasis:
    """Matrices from n control points to values, derivatives and hulls of a spline over [0, T].

    The derivative is a B-spline with the control points ``D_i = 5 (c_{i+1} - c_i) / (tau_{i+6} - tau_{i+1})``. A
    B-spline stays in the convex hull of its control points, so that limits on the control points hold at all times.

    Source:
        de Boor, "A Practical Guide to Splines", Springer 1978.

    Attributes:
        duration: Duration T [s].
        values: Matrices to the values and the first two derivatives at the sample times, shape (3, K, n).
        velocity_hull: Matrix to the control points of the first derivative, shape (n - 1, n).
        acceleration_hull: Matrix to the control points of the second derivative, shape (n - 2, n).
        gram: Integrals of the products of second derivatives of the basis functions, shape (n, n).
        knots: The knots [s], shape (n + 6,).
    """

    duration: float
    values: FloatArray
    velocity_hull: FloatArray
    acceleration_hull: FloatArray
    gram: FloatArray
    knots: FloatArray

    @property
    def times(self) -> FloatArray:
        """The sample times [s], shape (K,)."""
        return np.linspace(0.0, self.duration, self.values.shape[1])

    @property
    def free(self) -> slice:
        """Slice of the control points that the two ends do not determine."""
        return slice(FIXED, self.gram.shape[0] - FIXED)

    def ends(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return control points that are zero except for the first and last three, shape (n, 3).

        Args:
            start: Rows with position [m], velocity [m/s] and acceleration [m/s^2] at 0, shape (3, 3).
            end: Rows with the same at T, shape (3, 3).
        """
        points = np.zeros((self.gram.shape[0], 3))
        for rows, sample, state in ((slice(0, FIXED), 0, start), (slice(-FIXED, None), -1, end)):
            points[rows] = np.linalg.solve(self.values[:, sample, rows], state)
        return points

    def cheapest(self, points: FloatArray) -> FloatArray:
        """Return the control points with the smallest integral of squared acceleration and unchanged ends.

        Args:
            points: Control points [m], shape (n, 3).
        """
        free, result = self.free, points.copy()
        rest = points.copy()
        rest[free] = 0.0
        result[free] = np.linalg.solve(self.gram[free, free], -(self.gram @ rest)[free])
        return result


@dataclass(frozen=True, eq=False)
class SplinePath:
    """An `ApproachPath` given by a spline and its control points.

    Attributes:
        basis: The basis of the spline.
        points: Control points in W [m], shape (n, 3).
    """

    basis: SplineBasis
    points: FloatArray

    @property
    def duration(self) -> float:
        """Duration of the approach [s]."""
        return self.basis.duration

    @property
    def largest_speed(self) -> float:
        """Upper bound of the speed [m/s]."""
        return float(np.sqrt(((self.basis.velocity_hull @ self.points) ** 2).sum(axis=1)).max())

    @property
    def largest_distance(self) -> float:
        """Upper bound of the distance from the target's centre of mass [m]."""
        return float(np.sqrt((self.points**2).sum(axis=1)).max())

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position [m], velocity [m/s] and acceleration [m/s^2] at times since the start [s], (K, 3) each."""
        from scipy.interpolate import BSpline  # This import is slow.

        spline = BSpline(self.basis.knots, self.points, DEGREE)
        return spline(times), spline(times, 1), spline(times, 2)


@functools.lru_cache(maxsize=8)
def _unit_basis(count: int, samples: int) -> SplineBasis:
    """Return the basis over [0, 1]."""
    from scipy.interpolate import BSpline  # This import is slow.

    spans = count - DEGREE
    knots = np.concatenate((np.zeros(DEGREE), np.linspace(0.0, 1.0, spans + 1), np.ones(DEGREE)))
    basis = BSpline(knots, np.eye(count), DEGREE)
    times = np.linspace(0.0, 1.0, samples)
    first = _difference(knots, DEGREE, count)
    second = _difference(knots[1:-1], DEGREE - 1, count - 1) @ first
    # Gauss-Legendre quadrature of each span, which is exact for products of cubics.
    nodes, weights = np.polynomial.legendre.leggauss(4)
    nodes = ((np.arange(spans)[:, None] + 0.5 * (nodes + 1.0)) / spans).ravel()
    weights = np.tile(0.5 * weights / spans, spans)
    bend = basis(nodes, 2)
    gram = bend.T @ (bend * weights[:, None])
    return SplineBasis(1.0, np.stack([basis(times, k) for k in range(3)]), first, second, gram, knots)


def _difference(knots: FloatArray, degree: int, count: int) -> FloatArray:
    """Return the matrix from control points to those of the derivative, shape (count - 1, count)."""
    widths = knots[degree + 1 : degree + count] - knots[1:count]
    return np.asarray((degree / widths)[:, None] * (np.eye(count)[1:] - np.eye(count)[:-1]))


@functools.lru_cache(maxsize=32)
def spline_basis(count: int, samples: int, duration: float) -> SplineBasis:
    """Return a basis; calls with the same arguments return the same cached object.

    Args:
        count: Number of control points, at least 8.
        samples: Number of sample times, including the ends.
        duration: Duration T [s].
    """
    unit = _unit_basis(count, samples)
    return SplineBasis(
        duration,
        unit.values / np.array([1.0, duration, duration**2])[:, None, None],
        unit.velocity_hull / duration,
        unit.acceleration_hull / duration**2,
        unit.gram / duration**3,
        unit.knots * duration,
    )
