"""Elliptic integrals and Jacobi's amplitude, as row kernels.

They take the complementary parameter m1 = 1 - m, which near m = 1 retains the digits that m loses, and so remain
accurate as the modulus approaches one. The symmetric integrals are computed by duplication. Source: Carlson, "Numerical
computation of real or complex elliptic integrals", Numerical Algorithms 10, 1995.
"""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit

_LEVELS = 10  # of the arithmetic-geometric mean, at most; each doubles the correct digits: enough for m1 = 1e-30


@njit(error_model="numpy")
def complete_first(m1: float) -> float:
    """Return the complete integral of the first kind, ``K = pi / (2 AGM(1, sqrt(m1)))``."""
    a, b = 1.0, math.sqrt(m1)
    for _ in range(_LEVELS):
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    return 0.5 * math.pi / a


@njit(error_model="numpy")
def amplitude(u: float, m1: float) -> float:
    """Return Jacobi's amplitude am(u | 1 - m1) by the descending Landen transformation.

    The arcsine of the textbook recursion is replaced by an arctangent, which is accurate at the turning points.

    Args:
        u: The argument.
        m1: Complementary parameter in (0, 1].
    """
    levels, count = np.empty((_LEVELS, 3)), 0
    a, b = 1.0, math.sqrt(m1)
    while count < _LEVELS and (a != b or count == 0):  # further levels change nothing
        c = 0.5 * (a - b)
        a, b = 0.5 * (a + b), math.sqrt(a * b)
        levels[count, 0], levels[count, 1], levels[count, 2] = a, b, c
        count += 1
    phi = 2.0**count * a * u
    for level in range(count - 1, -1, -1):
        sine, cosine = math.sin(phi), math.cos(phi)
        across = math.hypot(levels[level, 0] * cosine, levels[level, 1] * sine)
        phi = 0.5 * (phi + math.atan2(levels[level, 2] * sine, across))
    return phi


@njit(error_model="numpy")
def _carlson_first(x: float, y: float, z: float) -> float:
    """Return Carlson's symmetric integral R_F of numbers of which at most one is 0, by duplication."""
    mean, scale = (x + y + z) / 3.0, 1.0
    dx, dy = mean - x, mean - y
    largest = 400.0 * max(abs(dx), abs(dy), abs(mean - z))  # (3 * 2e-16) ** (-1 / 6), rounded up
    while scale * largest >= mean:
        shift = math.sqrt(x * y) + math.sqrt(y * z) + math.sqrt(z * x)
        x, y, z, mean, scale = (
            0.25 * (x + shift),
            0.25 * (y + shift),
            0.25 * (z + shift),
            0.25 * (mean + shift),
            0.25 * scale,
        )
    dx, dy = scale * dx / mean, scale * dy / mean
    dz = -(dx + dy)
    e2, e3 = dx * dy - dz * dz, dx * dy * dz
    return (1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0) / math.sqrt(mean)


@njit(error_model="numpy")
def _carlson_third(x: float, y: float, z: float, p: float) -> float:
    """Return Carlson's symmetric integral R_J, for p not less than the others, of which at most one is 0."""
    mean, scale, total = (x + y + z + 2.0 * p) / 5.0, 1.0, 0.0
    dx, dy, dz, delta = mean - x, mean - y, mean - z, (p - x) * (p - y) * (p - z)
    largest = 600.0 * max(abs(dx), abs(dy), abs(dz), abs(mean - p))  # (2e-16 / 4) ** (-1 / 6), rounded up
    while scale * largest >= mean:
        a, b, c, d = math.sqrt(x), math.sqrt(y), math.sqrt(z), math.sqrt(p)
        shift, part = a * b + b * c + c * a, (d + a) * (d + b) * (d + c)
        e = scale**3 * delta / (part * part)
        total += scale / part * (math.atan(math.sqrt(e)) / math.sqrt(e) if e > 0.0 else 1.0)
        x, y, z, p = 0.25 * (x + shift), 0.25 * (y + shift), 0.25 * (z + shift), 0.25 * (p + shift)
        mean, scale = 0.25 * (mean + shift), 0.25 * scale
    dx, dy, dz = scale * dx / mean, scale * dy / mean, scale * dz / mean
    dp = -0.5 * (dx + dy + dz)
    e2, xyz = dx * dy + dx * dz + dy * dz - 3.0 * dp * dp, dx * dy * dz
    e3, e4, e5 = xyz + 2.0 * e2 * dp + 4.0 * dp**3, (2.0 * xyz + e2 * dp + 3.0 * dp**3) * dp, xyz * dp * dp
    series = 1.0 - 3.0 * e2 / 14.0 + e3 / 6.0 + 9.0 * e2 * e2 / 88.0 - 3.0 * e4 / 22.0 - 9.0 * e2 * e3 / 52.0
    return scale * (series + 3.0 * e5 / 26.0) / (mean * math.sqrt(mean)) + 6.0 * total


@njit(error_model="numpy")
def incomplete_third(nu: float, phi: float, m1: float) -> float:
    """Return the integral of 1 / ((1 + nu sin^2) sqrt(1 - m sin^2)) from 0 to phi, for any phi and nu >= 0.

    With nu = 0 it is the incomplete integral of the first kind, F(phi | 1 - m1).
    ``s R_F(c^2, d^2, 1) - nu / 3 s^3 R_J(c^2, d^2, 1, 1 + nu s^2)``, d^2 = c^2 + m1 s^2.

    Args:
        nu: The characteristic with the opposite sign.
        phi: Amplitude [rad].
        m1: Complementary parameter in (0, 1].
    """
    turns = round(phi / math.pi)
    sine, cosine = math.sin(phi - turns * math.pi), math.cos(phi - turns * math.pi)
    sine2, cosine2 = sine * sine, cosine * cosine
    delta2 = cosine2 + m1 * sine2
    third = _carlson_third(cosine2, delta2, 1.0, 1.0 + nu * sine2)
    part = sine * (_carlson_first(cosine2, delta2, 1.0) - nu / 3.0 * sine2 * third)
    if turns:
        part += 2.0 * turns * (complete_first(m1) - nu / 3.0 * _carlson_third(0.0, m1, 1.0, 1.0 + nu))
    return part
