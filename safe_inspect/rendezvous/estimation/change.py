"""Check whether the newest attitudes agree with the known motion."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, log, multiply
from safe_inspect.rendezvous.characterise.fit import Motion
from safe_inspect.rendezvous.characterise.history import TargetEstimate
from safe_inspect.rendezvous.characterise.ratios import logits_of
from safe_inspect.types import FloatArray

#: Number of the newest frames that must all be off, and by how many standard deviations each: a short series of views
#: in which the front end is wrong does not last that long.
OFF_FRAMES, _OFF_SIGMAS = 3, 3.0
#: Smallest deviation of rate or attitude that counts, in standard deviations, and absolute thresholds that cover the
#: front end's errors of a view [rad/s, rad].
_SIGMAS, _LEAST_RATE, _LEAST_ANGLE = 5.0, 0.009, 0.08


def motion_of(known: TargetEstimate) -> Motion:
    """Return the motion of an estimate."""
    return Motion(known.time, known.orientation, known.angular_velocity, logits_of(known.ratios))


def covariance_at(known: TargetEstimate, time: float) -> FloatArray:
    """Return the covariance of an estimate's tangent at another time [s], shape (8, 8)."""
    transition = motion_of(known).transition(time)
    return np.asarray(transition @ known.covariance @ transition.T)


def departs(known: TargetEstimate, times: FloatArray, orientation: FloatArray, sigma: float) -> bool:
    """Return whether measured attitudes deviate from a motion.

    A line ``e(t) = a + b (t - t_mean)`` is fitted to the errors ``e = Log(q_predicted^-1 q_measured)``: a is an error
    of the attitude, b one of the rate. Each is compared with the covariance of the motion and the errors of the frames,
    which may be the same for all frames (a) or accumulate from the first to the last (b). The newest frames must all be
    off.

    Args:
        known: The motion.
        times: Times of the newest frames [s], ascending, shape (n,).
        orientation: Measured q_WT of the frames, shape (n, 4).
        sigma: Stated standard deviation of their errors about each axis [rad]. It is multiplied by the misfit of all
            edges or of the newest, whichever is larger, because close to the target details that the model lacks
            rotate a few views.
    """
    sigma = sigma * max(known.misfit, known.recent_misfit, 1.0)
    if len(times) < OFF_FRAMES:
        return False
    error = log(multiply(conjugate(known.predict(times)[0]), orientation))
    since = times - times.mean()
    attitude, rate = error.mean(axis=0), since @ error / (since @ since)
    covariance = covariance_at(known, float(times[-1]))
    of_attitude = covariance[:3, :3] + sigma**2 * np.eye(3)
    of_rate = covariance[3:6, 3:6] + (2.0 * sigma / float(times[-1] - times[0])) ** 2 * np.eye(3)
    if any(_size(one, of_attitude) < _OFF_SIGMAS for one in error[-OFF_FRAMES:]):
        return False
    is_turned = _size(attitude, of_attitude) > _SIGMAS and np.linalg.norm(attitude) > _LEAST_ANGLE
    is_faster = _size(rate, of_rate) > _SIGMAS and np.linalg.norm(rate) > _LEAST_RATE
    return bool(is_turned or is_faster)


def _size(error: FloatArray, covariance: FloatArray) -> float:
    """Return the length of an error in standard deviations."""
    return float(np.sqrt(error @ np.linalg.solve(covariance, error)))
