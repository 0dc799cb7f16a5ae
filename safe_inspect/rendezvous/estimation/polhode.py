"""Principal axes and inertia ratios from the polhode, without an initial guess."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, log, multiply
from safe_inspect.types import FloatArray

#: Number of linear combinations of the two quadrics that are tried.
_ANGLES = 180
#: Limits of the singular values: the transverse axes are not observed if s6 / s5 is above or s5 / s1 below its limit.
_LARGEST_RATIO, _LEAST_RATIO = 0.5, 1e-2


def angular_velocities(
    times: FloatArray, orientation: FloatArray, span: float = 1.0, window: float = 5.0
) -> tuple[FloatArray, FloatArray]:
    """Return mid times [s], shape (n,), and smoothed angular velocities in the body's frame [rad/s], shape (n, 3).

    ``w = Log(R_k^T R_k+m) / (t_k+m - t_k)`` holds at the mid time, where m is the smallest number of frames that covers
    `span`. The rates are then smoothed with a Hann window about each mid time.

    Args:
        times: Times of the frames [s], ascending, shape (F,).
        orientation: Attitudes from the body's frame to an inertial one, shape (F, 4).
        span: Minimum time between two attitudes that are compared [s].
        window: Length of the window [s]; 0 for no smoothing.
    """
    later = np.searchsorted(times, times + span - 1e-9)
    first = np.flatnonzero(later < len(times))
    if not len(first):
        return np.empty(0), np.empty((0, 3))
    second = later[first]
    elapsed = times[second] - times[first]
    rates = log(multiply(conjugate(orientation[first]), orientation[second])) / elapsed[:, None]
    middle = 0.5 * (times[first] + times[second])
    if window <= 0.0:
        return middle, rates
    offset = np.abs(middle[:, None] - middle) / (0.5 * window)
    weight = np.where(offset < 1.0, 0.5 + 0.5 * np.cos(np.pi * offset), 0.0)
    # Fit a line to the rates in the window and evaluate it at the mid time: the mean is biased at the ends.
    centred = middle - middle[:, None]
    total, first_moment = weight.sum(axis=1), (weight * centred).sum(axis=1)
    second_moment = (weight * centred**2).sum(axis=1)
    determinant = total * second_moment - first_moment**2
    has_slope = determinant > 1e-9 * total**2
    safe = np.where(has_slope, determinant, 1.0)[:, None]
    mean = (weight @ rates) / total[:, None]
    line = (second_moment[:, None] * (weight @ rates) - first_moment[:, None] * ((weight * centred) @ rates)) / safe
    return middle, np.where(has_slope[:, None], line, mean)


class Polhode(NamedTuple):
    """Principal axes found from angular velocities.

    Attributes:
        axes: The axes of T in the frame of the angular velocities, as columns, with J1 <= J2 <= J3, shape (3, 3).
        ratios: k1 = J1 / J3 and k2 = J2 / J3, shape (2,).
        singular: Ratios s6 / s5 and s5 / s1 of the singular values.
        observable: Whether the transverse axes are observed.
    """

    axes: FloatArray
    ratios: FloatArray
    singular: tuple[float, float]
    observable: bool


def principal_axes_of_motion(times: FloatArray, rates: FloatArray) -> Polhode:
    """Return the ordered principal axes and the inertia ratios.

    A polhode lies on all quadrics ``w^T (a J + b J^2) w = const``. With rows [w1^2, w2^2, w3^2, 2 w1 w2, 2 w1 w3,
    2 w2 w3, -1], the two right singular vectors of the smallest singular values span them, and the eigenvectors of any
    member are the axes; the member with the largest relative gap between its eigenvalues is used. Euler's equations
    give the ratios: ``w_i(t) - w_i(0) = p_i int w_j w_k`` (i, j, k cyclic), ``p1 = (J2 - J3) / J1`` and so on; the axis
    whose p has the odd sign is axis 2, ``k1 = (1 + p3) / (1 - p1)`` and ``k2 = k1 - p3``. The directions along the
    axes remain undetermined except for the sign of the axis that the motion encircles.

    Source:
        Setterfield et al., "Inertial properties estimation of a passive on-orbit object using polhode analysis",
        JGCD 41 (2018); the equations were derived independently.

    Args:
        times: Times [s], ascending, shape (n,).
        rates: Angular velocities in a frame that is fixed in the body [rad/s], shape (n, 3).
    """
    scale = float(np.sqrt((rates**2).sum(axis=1).mean()))
    w = rates / scale
    a, b, c = w.T
    rows = np.stack((a * a, b * b, c * c, 2.0 * a * b, 2.0 * a * c, 2.0 * b * c, -np.ones_like(a)), axis=1)
    _, s, right = np.linalg.svd(rows, full_matrices=True)
    s = np.concatenate((s, np.zeros(7 - len(s))))
    floor = np.finfo(float).tiny
    singular = (float(s[5] / max(s[4], floor)), float(s[4] / max(s[0], floor)))
    first, second = (_symmetric(vector) for vector in right[5:])
    angles = np.arange(_ANGLES) * np.pi / _ANGLES
    members = np.cos(angles)[:, None, None] * first + np.sin(angles)[:, None, None] * second
    values = np.linalg.eigvalsh(members)
    gap = np.diff(values, axis=1).min(axis=1) / np.maximum(np.abs(values).max(axis=1), floor)
    axes = np.linalg.eigh(members[gap.argmax()])[1]
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    axes, ratios = _ordered(times, w @ axes * scale, axes)
    observable = singular[0] <= _LARGEST_RATIO and singular[1] >= _LEAST_RATIO and bool(np.isfinite(ratios).all())
    return Polhode(axes, ratios, singular, observable)


def _symmetric(v: FloatArray) -> FloatArray:
    return np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])


def _ordered(times: FloatArray, w: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ordered, right-handed axes and the ratios, given w in the axes, shape (n, 3)."""
    p = _euler_coefficients(times, w)
    # For J1 < J2 < J3, p1 < 0 < p2 and p3 < 0: one sign differs from the other two, in any order of the axes.
    signs = np.sign(p)
    odd = int(np.argmax(signs != np.sign(signs.sum()))) if abs(signs.sum()) == 1 else int(np.argmax(np.abs(p)))
    order = [(odd + 2) % 3, odd, (odd + 1) % 3]
    axes, p = axes[:, order], p[order]
    if p[1] < 0.0:
        axes = axes[:, [2, 1, 0]] * np.array([1.0, -1.0, 1.0])
        p = -p[[2, 1, 0]]
    k1 = (1.0 + p[2]) / (1.0 - p[0])
    ratios = np.array([k1, k1 - p[2]])
    return axes, ratios


def _euler_coefficients(times: FloatArray, w: FloatArray) -> FloatArray:
    """Return p of ``w_i' = p_i w_j w_k`` by least squares of the integrated equations, shape (3,)."""
    from scipy.integrate import cumulative_simpson

    p = np.zeros(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        integral = cumulative_simpson(w[:, j] * w[:, k], x=times, initial=0.0)
        matrix = np.stack((integral, np.ones_like(integral)), axis=1)
        p[i] = np.linalg.lstsq(matrix, w[:, i], rcond=None)[0][0]
    return p
