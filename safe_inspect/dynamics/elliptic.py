"""Elliptic functions and integrals that remain accurate as the modulus approaches one.

All functions take the complementary parameter m1 = 1 - m, which near m = 1 retains the digits that m loses.
"""

from __future__ import annotations

import numpy as np

from safe_inspect.types import FloatArray

_LEVELS = 10  # of the arithmetic-geometric mean; each doubles the correct digits: enough for m1 = 1e-30


def complete_first(m1: FloatArray) -> FloatArray:
    """Return the complete integral of the first kind, ``K = pi / (2 AGM(1, sqrt(m1)))``."""
    a, b = np.ones_like(m1), np.sqrt(m1)
    for _ in range(_LEVELS):
        a, b = 0.5 * (a + b), np.sqrt(a * b)
    return np.asarray(0.5 * np.pi / a)


def amplitude(u: FloatArray, m1: FloatArray) -> FloatArray:
    """Return Jacobi's amplitude am(u | 1 - m1) by the descending Landen transformation.

    The arcsine of the textbook recursion is replaced by an arctangent, which is accurate at the turning points.

    Args:
        u: Arguments, any size.
        m1: Complementary parameters in (0, 1], broadcast with u.
    """
    a, b = np.ones_like(m1), np.sqrt(m1)
    levels = []
    for _ in range(_LEVELS):
        c = 0.5 * (a - b)
        a, b = 0.5 * (a + b), np.sqrt(a * b)
        levels.append((a, b, c))
    phi: FloatArray = 2.0**_LEVELS * a * u
    for a, b, c in reversed(levels):
        sine, cosine = np.sin(phi), np.cos(phi)
        phi = 0.5 * (phi + np.arctan2(c * sine, np.sqrt((a * cosine) ** 2 + (b * sine) ** 2)))
    return phi


def incomplete_first(phi: FloatArray, m1: FloatArray) -> FloatArray:
    """Return F(phi | 1 - m1) for any phi, by Carlson's R_F."""
    from scipy.special import elliprf  # slow to import

    turns = np.round(phi / np.pi)
    sine, cosine = np.sin(phi - turns * np.pi), np.cos(phi - turns * np.pi)
    return np.asarray(sine * elliprf(cosine**2, cosine**2 + m1 * sine**2, 1.0) + 2.0 * turns * complete_first(m1))


def incomplete_third(nu: FloatArray, phi: FloatArray, m1: FloatArray) -> FloatArray:
    """Return the integral of 1 / ((1 + nu sin^2) sqrt(1 - m sin^2)) from 0 to phi, for any phi and nu >= 0.

    ``s R_F(c^2, d^2, 1) - nu / 3 s^3 R_J(c^2, d^2, 1, 1 + nu s^2)``, d^2 = c^2 + m1 s^2. Source: Carlson, "Computing
    elliptic integrals by duplication", Numerische Mathematik 33, 1979.

    Args:
        nu: The characteristic with the opposite sign.
        phi: Amplitudes [rad].
        m1: Complementary parameters in (0, 1].
    """
    from scipy.special import elliprf, elliprj  # slow to import

    turns = np.round(phi / np.pi)
    rest = phi - turns * np.pi
    sine, cosine2, delta2 = np.sin(rest), np.cos(rest) ** 2, np.cos(rest) ** 2 + m1 * np.sin(rest) ** 2
    part = sine * elliprf(cosine2, delta2, 1.0) - nu / 3.0 * sine**3 * elliprj(cosine2, delta2, 1.0, 1.0 + nu * sine**2)
    complete = elliprf(0.0, m1, 1.0) - nu / 3.0 * elliprj(0.0, m1, 1.0, 1.0 + nu)
    return np.asarray(part + 2.0 * turns * complete)
