"""Relative motion about a circular orbit: the Clohessy-Wiltshire-Hill (CWH) equations."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.types import FloatArray

# Below this angle [rad] the series of (x - sin x)/x^3 is more accurate than the difference.
_SERIES_ANGLE = 1.0
_SERIES_TERMS = 10


def system_matrices(mean_motion: float, mass: float) -> tuple[FloatArray, FloatArray]:
    """Return A and B of ``d(state)/dt = A state + B control``.

    In components, with n the chief's mean motion and u the thrust: ``x'' = 3 n^2 x + 2 n y' + u_x/m``,
    ``y'' = -2 n x' + u_y/m``, ``z'' = -n^2 z + u_z/m``.

    Args:
        mean_motion: Mean motion n of the chief's circular orbit [rad/s]; 0 means free space.
        mass: Mass m of the deputy [kg].

    Returns:
        A, shape (6, 6), and B, shape (6, 3). The state is the position [m] and the velocity [m/s]
        relative to the chief in Hill's frame; the control is a force [N].

    Raises:
        ValueError: The mean motion is negative, the mass is not positive, or one of them is not finite.

    Source:
        Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960.
    """
    _check(mean_motion, mass)
    n = mean_motion
    a = np.zeros((6, 6))
    a[0, 3] = a[1, 4] = a[2, 5] = 1.0
    a[3, 0] = 3.0 * n * n
    a[3, 4] = 2.0 * n
    a[4, 3] = -2.0 * n
    a[5, 2] = -n * n
    b = np.zeros((6, 3))
    b[3, 0] = b[4, 1] = b[5, 2] = 1.0 / mass
    return a, b


def transition(mean_motion: float, mass: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Return Phi and Gamma of the exact map ``state(t + step) = Phi state(t) + Gamma control``.

    The control is held over the step (zero-order hold), so that Phi = exp(A step) and Gamma is the integral of exp(A
    tau) B over the step. Both are evaluated in closed form, written so that a short step does not subtract nearly equal
    numbers: each entry is then accurate to a few units in its last place, whereas a numerical matrix exponential is
    accurate only relative to the largest entry.

    Args:
        mean_motion: Mean motion of the chief's orbit [rad/s]; 0 means free space.
        mass: Mass of the deputy [kg].
        step: Length of the step [s]; a negative step goes back in time.

    Returns:
        Phi, shape (6, 6), and Gamma, shape (6, 3), for SI states in Hill's frame and forces in newtons.

    Raises:
        ValueError: The mean motion is negative, the mass is not positive, or an argument is not finite.

    Source:
        Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960; Gamma by integration.
    """
    _check(mean_motion, mass)
    if not math.isfinite(step):
        raise ValueError(f"step must be finite, got {step}")
    n, t = mean_motion, step
    angle = n * t
    sine, cosine = math.sin(angle), math.cos(angle)
    f1, f2, f3 = _ratios(angle)
    lift = f2 * angle * angle  # 1 - cos
    lag = f3 * angle * angle * angle  # angle - sin

    phi = np.zeros((6, 6))
    phi[0, 0] = 1.0 + 3.0 * lift
    phi[0, 3] = t * f1
    phi[0, 4] = 2.0 * t * angle * f2
    phi[1, 0] = -6.0 * lag
    phi[1, 1] = 1.0
    phi[1, 3] = -phi[0, 4]
    phi[1, 4] = t * (4.0 * f1 - 3.0)
    phi[2, 2] = cosine
    phi[2, 5] = t * f1
    phi[3, 0] = 3.0 * n * sine
    phi[3, 3] = cosine
    phi[3, 4] = 2.0 * sine
    phi[4, 0] = -6.0 * n * lift
    phi[4, 3] = -2.0 * sine
    phi[4, 4] = 1.0 - 4.0 * lift
    phi[5, 2] = -n * sine
    phi[5, 5] = cosine

    gamma = np.zeros((6, 3))
    gamma[0, 0] = gamma[2, 2] = t * t * f2
    gamma[0, 1] = 2.0 * t * t * angle * f3
    gamma[1, 0] = -gamma[0, 1]
    gamma[1, 1] = t * t * (4.0 * f2 - 1.5)
    gamma[3, 0] = gamma[5, 2] = t * f1
    gamma[3, 1] = 2.0 * t * angle * f2
    gamma[4, 0] = -gamma[3, 1]
    gamma[4, 1] = phi[1, 4]
    return phi, gamma / mass


def _ratios(angle: float) -> tuple[float, float, float]:
    """Return sin(x)/x, (1 - cos x)/x^2 and (x - sin x)/x^3; at x = 0 their limits 1, 1/2 and 1/6."""
    if angle == 0.0:
        return 1.0, 0.5, 1.0 / 6.0
    f1 = math.sin(angle) / angle
    half = 0.5 * angle
    f2 = 0.5 * (math.sin(half) / half) ** 2
    if abs(angle) >= _SERIES_ANGLE:
        return f1, f2, (angle - math.sin(angle)) / angle**3
    f3 = 0.0
    for k in reversed(range(_SERIES_TERMS)):  # small terms first, for accuracy
        f3 += (-1.0) ** k * angle ** (2 * k) / math.factorial(2 * k + 3)
    return f1, f2, f3


def _check(mean_motion: float, mass: float) -> None:
    if not (math.isfinite(mean_motion) and mean_motion >= 0.0):
        raise ValueError(f"mean_motion must be finite and not negative [rad/s], got {mean_motion}")
    if not (math.isfinite(mass) and mass > 0.0):
        raise ValueError(f"mass must be finite and positive [kg], got {mass}")
