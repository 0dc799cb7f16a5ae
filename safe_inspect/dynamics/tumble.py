"""Torque-free rotation in closed form, for batches of bodies and times.

Moments J1 <= J2 <= J3 in the principal axes T, attitude q_WT. With 2T = w.Jw and L = |Jw|, the polhode encircles axis 3
if D2 = L^2 - 2T J2 >= 0 (case A) and axis 1 otherwise (case B). Jacobi's functions of u = p t + F(phi0 | m) give the
angular velocity, and with b1 along e_c x h, h = Jw / L, and F = [b1, h x b1, h],

    R_WT(t) = R_WT(0) F(0) Rz(psi) F(t)^T,      psi' = L (2T - J_c w_c^2) / (L^2 - J_c^2 w_c^2)

where c is the axis whose rate is proportional to cn: it is never parallel to the angular momentum, so psi has no pole.
Source: Landau and Lifshitz, "Mechanics", section 37.

The attitude is accurate to about 1e-15 L / (J p) rad: the accuracy is lower for a body whose angular velocity hardly
moves in T within an hour (1e-8 rad), and for one that spins about axis 2 to within 1e-11 of its rate (5e-6 rad).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.elliptic import amplitude, complete_first, incomplete_third
from safe_inspect.dynamics.rotation_row import product
from safe_inspect.types import FloatArray, IntArray

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
    """Constants of a body's motion; c is the axis of cn, d that of dn."""

    steady: bool
    about3: bool
    a1: float  # amplitudes of cn, sn and dn along the axes 1 to 3
    a2: float
    a3: float
    sign: float
    rate: float  # p [1/s]
    m1: float  # 1 - m
    phi0: float
    turning: float  # L / J_c
    coefficient: float  # L (2T - L^2 / J_c) / (beta p)
    nu: float


@njit(error_model="numpy")  # a steady motion divides by zero; what follows from it is not used
def _polhode(inertia: FloatArray, angular_velocity: FloatArray) -> _Polhode:
    j1, j2, j3 = inertia[0], inertia[1], inertia[2]
    w1, w2, w3 = angular_velocity[0], angular_velocity[1], angular_velocity[2]
    momentum = math.sqrt((j1 * w1) ** 2 + (j2 * w2) ** 2 + (j3 * w3) ** 2)
    c1, c2, c3 = (j3 - j2) * w2 * w3, (j1 - j3) * w3 * w1, (j2 - j1) * w1 * w2
    speed = math.sqrt(w1 * w1 + w2 * w2 + w3 * w3)
    steady = math.sqrt(c1 * c1 + c2 * c2 + c3 * c3) <= _STEADY * speed * momentum
    d1 = j2 * (j2 - j1) * w2**2 + j3 * (j3 - j1) * w3**2
    d2 = j1 * (j1 - j2) * w1**2 + j3 * (j3 - j2) * w3**2
    d3 = j1 * (j3 - j1) * w1**2 + j2 * (j3 - j2) * w2**2
    about3 = d2 >= 0.0
    a1, a3 = math.sqrt(d3 / (j1 * (j3 - j1))), math.sqrt(d1 / (j3 * (j3 - j1)))
    if about3:
        a2, large, sign = math.sqrt(d3 / (j2 * (j3 - j2))), (j3 - j2) * d1, math.copysign(1.0, w3)
        cosine, beta, cn_inertia, nu, over = w1 / a1, (j3 * a3) ** 2, j1, (j1 * a1) ** 2, -d1 / j1
    else:
        a2, large, sign = math.sqrt(d1 / (j2 * (j2 - j1))), (j2 - j1) * d3, math.copysign(1.0, w1)
        cosine, beta, cn_inertia, nu, over = w3 / a3, (j1 * a1) ** 2, j3, (j3 * a3) ** 2, d3 / j3
    rate = math.sqrt(large / (j1 * j2 * j3))
    m1 = min(max((j3 - j1) * abs(d2) / large, _LEAST_M1), 1.0)
    sine = sign * w2 / a2
    phi0 = math.atan2(sine if math.isfinite(sine) else 0.0, cosine if math.isfinite(cosine) else 1.0)
    coefficient = momentum * over / (beta * rate)
    return _Polhode(steady, about3, a1, a2, a3, sign, rate, m1, phi0, momentum / cn_inertia, coefficient, nu / beta)


@njit(error_model="numpy")
def _frame(inertia: FloatArray, w: FloatArray, about3: bool) -> tuple[float, float, float, float]:
    """Return the attitude of the frame F = [b1, h x b1, h] in T.

    With b1 = R_c(a) e_2, it is the product of R_c(a), a rotation about axis 2, and one that permutes the axes.
    """
    h1, h2, h3 = inertia[0] * w[0], inertia[1] * w[1], inertia[2] * w[2]
    if about3:
        half, tilt = 0.5 * math.atan2(h2, -h3), 0.5 * math.atan2(-h1, math.hypot(h2, h3))
        turned = product((math.sin(half), 0.0, 0.0, math.cos(half)), (0.0, math.sin(tilt), 0.0, math.cos(tilt)))
        return product(turned, (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))
    half, tilt = 0.5 * math.atan2(h2, h1), 0.5 * math.atan2(-h3, math.hypot(h1, h2))
    turned = product((0.0, 0.0, math.sin(half), math.cos(half)), (0.0, math.sin(tilt), 0.0, math.cos(tilt)))
    return product(turned, (0.5, 0.5, 0.5, 0.5))


def _checked(inertia: FloatArray, angular_velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    angular_velocity = np.ascontiguousarray(angular_velocity, dtype=np.float64)
    inertia = np.ascontiguousarray(np.broadcast_to(inertia, (len(angular_velocity), 3)), dtype=np.float64)
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
    orientation, times = (np.ascontiguousarray(value, dtype=np.float64) for value in (orientation, times))
    q = np.empty((len(angular_velocity), len(times), 4))
    w = np.empty((len(angular_velocity), len(times), 3))
    _tumble(inertia, orientation, angular_velocity, times, q, w)
    return q, w


@njit(error_model="numpy")
def _tumble(
    inertia: FloatArray, orientation: FloatArray, start: FloatArray, times: FloatArray, q: FloatArray, w: FloatArray
) -> None:
    for n in range(len(start)):
        body, before = _polhode(inertia[n], start[n]), orientation[n]
        x, y, z = start[n, 0], start[n, 1], start[n, 2]
        first, speed = (0.0, 0.0, 0.0, 1.0), math.sqrt(x * x + y * y + z * z)
        begun, begun_third = 0.0, 0.0
        if not body.steady:
            first = _frame(inertia[n], start[n], body.about3)
            begun = incomplete_third(0.0, body.phi0, body.m1)
            begun_third = incomplete_third(body.nu, body.phi0, body.m1)
        first = product(orientation[n], first)
        for k in range(len(times)):
            if body.steady:
                w[n, k] = start[n]
                half = 0.5 * speed * times[k]
                scale = math.sin(half) / speed if speed > 0.0 else 0.0
                found = product(first, (scale * x, scale * y, scale * z, math.cos(half)))
            else:
                phi = amplitude(body.rate * times[k] + begun, body.m1)
                w[n, k, 0], w[n, k, 1], w[n, k, 2] = _rates(body, phi)
                third = incomplete_third(body.nu, phi, body.m1) - begun_third
                half = 0.5 * (body.turning * times[k] + body.coefficient * third)
                last = _frame(inertia[n], w[n, k], body.about3)
                turned = product(first, (0.0, 0.0, math.sin(half), math.cos(half)))
                found = product(turned, (-last[0], -last[1], -last[2], last[3]))
            same = found[0] * before[0] + found[1] * before[1] + found[2] * before[2] + found[3] * before[3]
            for i in range(4):
                q[n, k, i] = -found[i] if same < 0.0 else found[i]
            before = q[n, k]


@njit(error_model="numpy")
def _rates(body: _Polhode, phi: float) -> tuple[float, float, float]:
    """Return the angular velocity at an amplitude."""
    sn, cn = math.sin(phi), math.cos(phi)
    dn = body.sign * math.sqrt(cn * cn + body.m1 * sn * sn)
    of1, of3 = (cn, dn) if body.about3 else (dn, cn)
    return body.a1 * of1, body.sign * body.a2 * sn, body.a3 * of3


@njit(error_model="numpy")
def _classify(inertia: FloatArray, angular_velocity: FloatArray, out: FloatArray) -> None:
    for n in range(len(angular_velocity)):
        w, body = angular_velocity[n], _polhode(inertia[n], angular_velocity[n])
        if body.steady:
            out[n, 0], out[n, 1], out[n, 2] = 0.0, np.inf, 0.0
            out[n, 3] = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            continue
        along, across = (body.a3, body.a1) if body.about3 else (body.a1, body.a3)
        out[n, 0], out[n, 1] = 3.0 if body.about3 else 1.0, 4.0 * complete_first(body.m1) / body.rate
        out[n, 2] = max(math.atan2(across, along), math.atan2(body.a2, along * math.sqrt(body.m1)))
        # Along a polhode |w|^2 is linear in sn^2, so it is largest where sn is 0 or 1.
        out[n, 3] = math.sqrt(max(along**2 + across**2, body.a2**2 + body.m1 * along**2))


def _constants(inertia: FloatArray, angular_velocity: FloatArray) -> FloatArray:
    """Return axis, period, extent and largest rate of each motion, shape (n, 4)."""
    inertia, angular_velocity = _checked(inertia, angular_velocity)
    out = np.empty((len(angular_velocity), 4))
    _classify(inertia, angular_velocity, out)
    return out


def classify(inertia: FloatArray, angular_velocity: FloatArray) -> TumbleKind:
    """Return the axis about which bodies tumble, the period, and the amplitude of the motion.

    Args:
        inertia: Principal moments J1 <= J2 <= J3, up to a common factor per body, shape (n, 3) or (3,).
        angular_velocity: Angular velocities in T [rad/s], shape (n, 3).
    """
    out = _constants(inertia, angular_velocity)
    return TumbleKind(out[:, 0].astype(np.int64), out[:, 1], out[:, 2])


def largest_rate(inertia: FloatArray, angular_velocity: FloatArray) -> FloatArray:
    """Return the largest magnitude that the angular velocities reach [rad/s], shape (n,).

    Args:
        inertia: Principal moments J1 <= J2 <= J3, up to a common factor per body, shape (n, 3) or (3,).
        angular_velocity: Angular velocities in T [rad/s], shape (n, 3).
    """
    return _constants(inertia, angular_velocity)[:, 3]


def angular_acceleration(inertia: FloatArray, angular_velocity: FloatArray) -> FloatArray:
    """Return the angular acceleration without torque, ``-J^-1 (w x J w)`` [rad/s^2], in T, shape (..., 3).

    Args:
        inertia: Principal moments, shape (..., 3).
        angular_velocity: Angular velocities in T [rad/s], shape (..., 3).
    """
    j1, j2, j3 = inertia[..., 0], inertia[..., 1], inertia[..., 2]
    w1, w2, w3 = angular_velocity[..., 0], angular_velocity[..., 1], angular_velocity[..., 2]
    return np.stack(((j2 - j3) / j1 * w2 * w3, (j3 - j1) / j2 * w3 * w1, (j1 - j2) / j3 * w1 * w2), axis=-1)
