"""Torque-free rotation in closed form, for batches of bodies and times.

Moments J1 <= J2 <= J3 in the principal axes T, attitude q_WT. With 2T = w.Jw and L = |Jw|, the polhode encircles axis 3
if D2 = L^2 - 2T J2 >= 0 (case A) and axis 1 otherwise (case B). Jacobi's functions of u = p t + F(phi0 | m) give the
angular velocity, and with b1 along e_c x h, h = Jw / L, and F = [b1, h x b1, h],

    R_WT(t) = R_WT(0) F(0) Rz(psi) F(t)^T,      psi' = L (2T - J_c w_c^2) / (L^2 - J_c^2 w_c^2)

where c is the axis whose rate is proportional to cn: it is never parallel to the angular momentum, so psi has no pole.
Sources: Landau and Lifshitz, "Mechanics", section 37; Carlson, "Computing elliptic integrals by duplication", Numer.
Math. 33, 1979.

The attitude is accurate to about 1e-15 L / (J p) rad: the accuracy is lower for a body whose angular velocity hardly
moves in T within an hour (1e-8 rad), and for one that spins about axis 2 to within 1e-11 of its rate (5e-6 rad).

The elliptic functions and integrals remain accurate as the modulus approaches one: they take the complementary
parameter m1 = 1 - m, which near m = 1 retains the digits that m loses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import continuous, exp, from_matrix, multiply
from safe_inspect.types import BoolArray, FloatArray, IntArray

_LEVELS = 10  # of the arithmetic-geometric mean, at most; each doubles the correct digits: enough for m1 = 1e-30


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
        if (a == b).all():  # further levels change nothing
            break
    phi: FloatArray = 2.0 ** len(levels) * a * u
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


_STEADY = 1e-13  # |w x Jw| / (|w| L) below which the angular velocity is constant
_LEAST_M1 = 1e-30  # on the separatrix itself the period is infinite; with this value it is long enough


class TumbleKind(NamedTuple):
    """Kind of the tumbling motion of bodies.

    Attributes:
        axis: The axis that the polhode encircles, 1 or 3; 0 if the angular velocity is constant, shape (n,).
        period: Period of the angular velocity in T [s]; infinite if it is constant, shape (n,).
        extent: Largest angle between angular velocity and that axis [rad]; 0 if it is constant, shape (n,).
    """

    axis: IntArray
    period: FloatArray
    extent: FloatArray


class _Polhode(NamedTuple):
    """Constants of rows of bodies, shape (n,) each; c is the axis of cn, d that of dn."""

    steady: BoolArray
    about3: BoolArray
    amplitudes: FloatArray  # (n, 3), amplitudes of cn, sn and dn along the axes 1 to 3
    sign: FloatArray
    rate: FloatArray  # p [1/s]
    m1: FloatArray  # 1 - m
    phi0: FloatArray
    momentum: FloatArray  # L
    cn_inertia: FloatArray  # J_c
    coefficient: FloatArray  # L (2T - L^2 / J_c) / (beta p)
    nu: FloatArray


def _polhode(inertia: FloatArray, angular_velocity: FloatArray) -> _Polhode:
    j1, j2, j3 = inertia.T
    w1, w2, w3 = angular_velocity.T
    momentum = np.sqrt((j1 * w1) ** 2 + (j2 * w2) ** 2 + (j3 * w3) ** 2)
    c1, c2, c3 = (j3 - j2) * w2 * w3, (j1 - j3) * w3 * w1, (j2 - j1) * w1 * w2
    speed = np.sqrt(w1 * w1 + w2 * w2 + w3 * w3)
    steady = np.sqrt(c1 * c1 + c2 * c2 + c3 * c3) <= _STEADY * speed * momentum
    with np.errstate(divide="ignore", invalid="ignore"):  # steady rows divide by zero; their values are not used
        d1 = j2 * (j2 - j1) * w2**2 + j3 * (j3 - j1) * w3**2
        d2 = j1 * (j1 - j2) * w1**2 + j3 * (j3 - j2) * w3**2
        d3 = j1 * (j3 - j1) * w1**2 + j2 * (j3 - j2) * w2**2
        about3 = d2 >= 0.0
        a1, a3 = np.sqrt(d3 / (j1 * (j3 - j1))), np.sqrt(d1 / (j3 * (j3 - j1)))
        a2 = np.sqrt(np.where(about3, d3 / (j2 * (j3 - j2)), d1 / (j2 * (j2 - j1))))
        large = np.where(about3, (j3 - j2) * d1, (j2 - j1) * d3)
        rate = np.sqrt(large / (j1 * j2 * j3))
        m1 = np.clip((j3 - j1) * np.abs(d2) / large, _LEAST_M1, 1.0)
        sign = np.where(np.where(about3, w3, w1) < 0.0, -1.0, 1.0)
        over2, over_c = sign * w2 / a2, np.where(about3, w1 / a1, w3 / a3)
        phi0 = np.arctan2(np.nan_to_num(over2), np.where(np.isfinite(over_c), over_c, 1.0))
        beta = np.where(about3, (j3 * a3) ** 2, (j1 * a1) ** 2)
        cn_inertia = np.where(about3, j1, j3)
        nu = np.where(about3, j1 * a1, j3 * a3) ** 2 / beta
        coefficient = momentum * np.where(about3, -d1 / j1, d3 / j3) / (beta * rate)
    amplitudes = np.stack((a1, a2, a3), axis=1)
    return _Polhode(steady, about3, amplitudes, sign, rate, m1, phi0, momentum, cn_inertia, coefficient, nu)


def _frames(inertia: FloatArray, angular_velocity: FloatArray, about3: BoolArray) -> FloatArray:
    """Return the frames F = [b1, h x b1, h] in T, shape (n, k, 3, 3)."""
    h = inertia[:, None] * angular_velocity
    h /= np.sqrt(h[..., 0] ** 2 + h[..., 1] ** 2 + h[..., 2] ** 2)[..., None]
    x, y, z = h[..., 0], h[..., 1], h[..., 2]
    zero = np.zeros_like(x)
    first = np.where(about3[:, None, None], np.stack((zero, -z, y), axis=-1), np.stack((-y, x, zero), axis=-1))
    first /= np.sqrt(first[..., 0] ** 2 + first[..., 1] ** 2 + first[..., 2] ** 2)[..., None]
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    second = np.stack((y * c - z * b, z * a - x * c, x * b - y * a), axis=-1)
    return np.stack((first, second, h), axis=-1)


def _checked(inertia: FloatArray, angular_velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    angular_velocity = np.asarray(angular_velocity, dtype=np.float64)
    inertia = np.broadcast_to(np.asarray(inertia, dtype=np.float64), (len(angular_velocity), 3))
    j1, j2, j3 = inertia.T
    if not (np.isfinite(inertia).all() and (j1 > 0.0).all() and (j1 <= j2).all() and (j2 <= j3).all()):
        raise ValueError("tumble: the inertia must be positive and ordered, J1 <= J2 <= J3")
    if (j1 + j2 < j3 * (1.0 - 1e-12)).any():
        raise ValueError("tumble: the principal moments of a body cannot have J1 + J2 < J3")
    return inertia, angular_velocity


def tumble(
    inertia: FloatArray, orientation: FloatArray, angular_velocity: FloatArray, times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return attitudes and angular velocities of torque-free bodies.

    Args:
        inertia: Principal moments J1 <= J2 <= J3, up to a common factor per body, shape (n, 3) or (3,).
        orientation: Attitudes q_WT at time zero, shape (n, 4).
        angular_velocity: Angular velocities in T at time zero [rad/s], shape (n, 3).
        times: Times [s], of any sign, shape (k,).

    Returns:
        Attitudes q_WT, of continuous sign, shape (n, k, 4), and angular velocities in T [rad/s], shape (n, k, 3).

    Raises:
        ValueError: The moments are not those of a rigid body, or are not in this order.
    """
    inertia, angular_velocity = _checked(inertia, angular_velocity)
    orientation, times = np.asarray(orientation, dtype=np.float64), np.asarray(times, dtype=np.float64)
    q = np.empty((len(angular_velocity), len(times), 4))
    w = np.empty((len(angular_velocity), len(times), 3))
    constants = _polhode(inertia, angular_velocity)
    steady, moving = constants.steady, ~constants.steady
    if steady.any():
        w[steady] = angular_velocity[steady, None]
        q[steady] = multiply(orientation[steady, None], exp(angular_velocity[steady, None] * times[:, None]))
    if moving.any():
        rows = _Polhode._make(array[moving] for array in constants)
        w[moving], phi, phi0 = _rates(rows, times)
        third = incomplete_third(rows.nu[:, None], np.concatenate((phi, phi0), axis=1), rows.m1[:, None])
        psi = (rows.momentum / rows.cn_inertia)[:, None] * times
        psi += rows.coefficient[:, None] * (third[:, :-1] - third[:, -1:])
        turn = np.stack((np.zeros_like(psi), np.zeros_like(psi), np.sin(0.5 * psi), np.cos(0.5 * psi)), axis=-1)
        first = _frames(inertia[moving], angular_velocity[moving, None], rows.about3)
        at_start = multiply(orientation[moving, None], from_matrix(first))
        last = from_matrix(np.swapaxes(_frames(inertia[moving], w[moving], rows.about3), -1, -2))
        q[moving] = multiply(multiply(at_start, turn), last)
    return continuous(q, orientation), w


def _rates(rows: _Polhode, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return angular velocities (n, k, 3), Jacobi's amplitudes (n, k), and the amplitudes at time zero (n, 1)."""
    m1, sign, about3 = rows.m1[:, None], rows.sign[:, None], rows.about3[:, None]
    phi0 = rows.phi0[:, None]
    phi = amplitude(rows.rate[:, None] * times + incomplete_first(phi0, m1), m1)
    sn, cn = np.sin(phi), np.cos(phi)
    dn = sign * np.sqrt(cn * cn + m1 * sn * sn)
    a1, a2, a3 = rows.amplitudes[:, 0, None], rows.amplitudes[:, 1, None], rows.amplitudes[:, 2, None]
    w = np.stack((a1 * np.where(about3, cn, dn), sign * a2 * sn, a3 * np.where(about3, dn, cn)), axis=-1)
    return w, phi, phi0


def classify(inertia: FloatArray, angular_velocity: FloatArray) -> TumbleKind:
    """Return the axis about which bodies tumble, the period, and the amplitude of the motion.

    Args:
        inertia: Principal moments J1 <= J2 <= J3, up to a common factor per body, shape (n, 3) or (3,).
        angular_velocity: Angular velocities in T [rad/s], shape (n, 3).
    """
    rows = _polhode(*_checked(inertia, angular_velocity))
    a1, a2, a3 = rows.amplitudes.T
    with np.errstate(divide="ignore", invalid="ignore"):
        period = 4.0 * complete_first(np.where(rows.steady, 1.0, rows.m1)) / rows.rate
        along = np.where(rows.about3, a3, a1)
        across = np.where(rows.about3, a1, a3)
        extent = np.maximum(np.arctan2(across, along), np.arctan2(a2, along * np.sqrt(rows.m1)))
    return TumbleKind(
        np.where(rows.steady, 0, np.where(rows.about3, 3, 1)).astype(np.int64),
        np.where(rows.steady, np.inf, period),
        np.where(rows.steady, 0.0, extent),
    )


def largest_rate(inertia: FloatArray, angular_velocity: FloatArray) -> FloatArray:
    """Return the largest magnitude that the angular velocities reach [rad/s], shape (n,).

    Along a polhode ``|w|^2`` is linear in sn^2, so it is largest where sn is 0 or 1.

    Args:
        inertia: Principal moments J1 <= J2 <= J3, up to a common factor per body, shape (n, 3) or (3,).
        angular_velocity: Angular velocities in T [rad/s], shape (n, 3).
    """
    inertia, angular_velocity = _checked(inertia, angular_velocity)
    rows = _polhode(inertia, angular_velocity)
    a1, a2, a3 = (rows.amplitudes**2).T
    moving = np.sqrt(np.maximum(a1 + a3, a2 + rows.m1 * np.where(rows.about3, a3, a1)))
    bound: FloatArray = np.where(rows.steady, np.sqrt((angular_velocity**2).sum(axis=1)), moving)
    return bound


def angular_acceleration(inertia: FloatArray, angular_velocity: FloatArray) -> FloatArray:
    """Return the angular acceleration without torque, ``-J^-1 (w x J w)`` [rad/s^2], in T, shape (..., 3).

    Args:
        inertia: Principal moments, shape (..., 3).
        angular_velocity: Angular velocities in T [rad/s], shape (..., 3).
    """
    j1, j2, j3 = inertia[..., 0], inertia[..., 1], inertia[..., 2]
    w1, w2, w3 = angular_velocity[..., 0], angular_velocity[..., 1], angular_velocity[..., 2]
    return np.stack(((j2 - j3) / j1 * w2 * w3, (j3 - j1) / j2 * w3 * w1, (j1 - j2) / j3 * w1 * w2), axis=-1)
