"""Check whether the errors of an estimate agree with those that it states."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, exp, log, multiply, rotate
from safe_inspect.rendezvous.bound.query import JointErrors
from safe_inspect.rendezvous.estimate import BodyState, StateEstimate
from safe_inspect.types import FloatArray


def attitude_error(estimate: StateEstimate, chaser: BodyState, target: BodyState) -> FloatArray:
    """Return the error of the target's attitude relative to the chaser, R_BT, as a tangent in T [rad], shape (3,).

    A rotation of the estimated frame W cannot be measured and does not count: it moves chaser and target equally.

    Args:
        estimate: The estimate.
        chaser: The chaser's true state.
        target: The target's true state.
    """
    return relative_error(
        (estimate.chaser.orientation, estimate.target.orientation), (chaser.orientation, target.orientation)
    )


def relative_error(estimated: tuple[FloatArray, FloatArray], true: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return the error of `attitude_error` from estimated and true quaternions q_WB and q_WT, shape (..., 4)."""
    seen, real = (multiply(conjugate(chaser), target) for chaser, target in (estimated, true))
    return log(multiply(conjugate(real), seen))


def normalised_error(estimate: StateEstimate, chaser: BodyState, target: BodyState) -> float:
    """Return the normalised squared error of attitude and angular velocity (NEES); NaN without a covariance.

    It is 6 on average if the covariance is right; nothing is aligned to the truth. The error is the tangent of the
    estimate: the truth is ``q Exp(a)`` and ``Exp(-a) w + r``, see `JointErrors`.
    """
    if not isinstance(estimate.errors, JointErrors):
        return float("nan")
    joint = estimate.errors.joint
    turn = attitude_error(estimate, chaser, target)  # the estimate as seen from the truth: -a
    rate = target.angular_velocity - rotate(exp(turn), estimate.target.angular_velocity)
    error = np.concatenate([-turn, rate])
    return float(error @ np.linalg.solve(joint[2:8, 2:8], error))
