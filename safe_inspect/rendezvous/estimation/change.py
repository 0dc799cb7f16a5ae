"""Change detection: jumps of the inertial unit's biases, frames that disagree, and changes of the target's motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, log, multiply, rotate
from safe_inspect.dynamics.tumble import angular_acceleration
from safe_inspect.rendezvous.estimation.factors import BIAS_JUMP, BiasJump
from safe_inspect.rendezvous.estimation.states import GraphEstimate, History, Motion, TargetEstimate, logits_of
from safe_inspect.rendezvous.inertial_unit import ImuNoise, InertialSample
from safe_inspect.rendezvous.models import ChaserConfig
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse
from safe_inspect.rendezvous.readings import Command
from safe_inspect.types import FloatArray

#: Fraction of a force or torque that is uncertain for any actuators, because the chaser turns within a step, and the
#: smallest standard deviation of the angular acceleration [rad/s^2].
_SHARE, _LEAST = 0.02, 1e-4
#: Largest distance of an exponential response from its chord within a step, as a fraction of its change.
_CURVATURE = 0.125
#: Innovation beyond which a jump is suspected, in standard deviations of one axis.
_GATE = 6.0
#: Variance of an unknown motion.
_UNKNOWN = 1.0
#: Number of the newest frames that must all be off, and by how many standard deviations each: a short series of views
#: in which the front end is wrong does not last that long.
OFF_FRAMES, _OFF_SIGMAS = 3, 3.0
#: Smallest deviation of rate or attitude that counts, in standard deviations, and absolute thresholds that cover the
#: front end's errors of a view [rad/s, rad].
_SIGMAS, _LEAST_RATE, _LEAST_ANGLE = 5.0, 0.009, 0.08
#: Standard deviations of a motion that is found from a few frames only [rad, rad/s], and the time span of these
#: frames [s].
_QUICK_SIGMA, QUICK_SPAN = (0.05, 0.02), 3.0


class ExpectedMotion(NamedTuple):
    """Motion that the actuators are expected to cause in a control step.

    Attributes:
        mean: Mean acceleration and angular acceleration over the step, in B [m/s^2, rad/s^2], shape (6,).
        sigma: Standard deviations of one axis of each [m/s^2, rad/s^2], shape (2,).
    """

    mean: FloatArray
    sigma: FloatArray


class ActuatorResponse:
    """Predictor of the motion of a step from commands and the documented errors of the actuators.

    Args:
        config: The chaser. The lag of its actuators shapes the prediction; scale error and noise give its uncertainty.
        step: The control period [s].
    """

    def __init__(self, config: ChaserConfig, step: float) -> None:
        self._config, self._wrench = config, np.zeros(6)
        lag = config.actuator.lag
        #: Fractions of the difference to the command that remain at the end of a step, and in its mean.
        self._left = float(np.exp(-step / lag)) if lag > 0.0 else 0.0
        self._mean = lag / step * (1.0 - self._left)

    def step(self, angular_velocity: FloatArray, command: Command) -> ExpectedMotion:
        """Return the motion caused by a command that is constant over a step.

        Args:
            angular_velocity: Estimated angular velocity of the chaser before the step, in B [rad/s], shape (3,).
            command: The command.
        """
        config, own = self._config, self._config.actuator
        moments: FloatArray = np.array(config.inertia)
        held = np.concatenate(command)
        difference = self._wrench - held
        mean, self._wrench = held + self._mean * difference, held + self._left * difference
        bent = _CURVATURE * (1.0 - self._left) * difference if own.lag > 0.0 else np.zeros(6)
        sizes = np.linalg.norm(np.reshape([mean, bent], (2, 2, 3)), axis=2)
        sigma = (_SHARE + abs(own.scale_error)) * sizes[0] + sizes[1]
        sigma = np.hypot(sigma, np.array([own.force_noise, own.torque_noise]) / np.sqrt(3.0))
        free = angular_acceleration(moments, angular_velocity)
        return ExpectedMotion(
            np.concatenate([mean[:3] / config.mass, free + mean[3:] / moments]),
            np.array([sigma[0] / config.mass, np.hypot(sigma[1] / moments.min(), _LEAST)]),
        )


class _Channel:
    """Kalman filter of a motion and of the jump of its bias since the last frame; the axes share one covariance.

    Args:
        opened: Standard deviation that is assigned to the jump when one is suspected.
    """

    def __init__(self, opened: float) -> None:
        self._opened = opened
        self._state, self._covariance = np.zeros((2, 3)), np.diag([_UNKNOWN, 0.0])

    @property
    def jump(self) -> FloatArray:
        """The jump since the last frame, shape (3,)."""
        return np.asarray(self._state[1])

    @property
    def variance(self) -> float:
        """Variance of the jump; 0 if none is suspected."""
        return float(self._covariance[1, 1])

    def predict(self, kept: float, change: FloatArray, sigma: float) -> None:
        """Multiply the motion by the factor `kept` and add a change with its standard deviation."""
        transition = np.diag([kept, 1.0])
        self._state = transition @ self._state + np.outer([1.0, 0.0], change)
        self._covariance = transition @ self._covariance @ transition + np.diag([sigma**2, 0.0])

    def measure(self, value: FloatArray, sigma: float) -> None:
        """Update the filter with a measurement of the motion plus the jump."""
        innovation = value - self._state.sum(axis=0)
        if innovation @ innovation > _GATE**2 * (self._covariance.sum() + sigma**2):
            self._covariance[1, 1] += self._opened**2
        cross = self._covariance.sum(axis=1)
        gain = cross / (cross.sum() + sigma**2)
        self._state = self._state + np.outer(gain, innovation)
        self._covariance = self._covariance - np.outer(gain, cross)

    def settle(self) -> None:
        """Count the jump as part of the bias."""
        self._state = np.stack([self._state.sum(axis=0), np.zeros(3)])
        self._covariance = np.diag([self._covariance.sum(), 0.0])

    def interrupt(self) -> None:
        """Discard the motion; the jump is not changed."""
        self._covariance = np.diag([_UNKNOWN, self.variance])


class BiasJumps:
    """Detector of bias jumps that compares samples with the expected motion between two frames.

    The mean specific force of a step is ``f / m + b_a``, and the angular velocity changes from the mean time of a
    step's samples to that of the next by the expected angular acceleration. An innovation beyond `_GATE` opens the
    bias: from then on its jump and a covariance are estimated from the samples, which depth frames alone would allow
    only seconds later. At the next frame the factor graph takes over jump and covariance and continues to estimate the
    bias, so that no correction lasts longer than that.

    Args:
        noise: Errors of the unit.
    """

    def __init__(self, noise: ImuNoise) -> None:
        self._noise = noise
        self._acceleration, self._rate = (_Channel(opened) for opened in BIAS_JUMP)
        #: Angular acceleration expected from the last samples to the end of their step, its sigma, and that duration.
        self._rest: tuple[FloatArray, float, float] = (np.zeros(3), 0.0, 0.0)

    def settle(self) -> None:
        """Record that the graph now counts the jump as part of the bias."""
        self._acceleration.settle()
        self._rate.settle()

    def check(
        self, samples: Sequence[InertialSample], expected: ExpectedMotion, bias: FloatArray, duration: float
    ) -> BiasJump | None:
        """Return the jump since the last frame; None if none is suspected or the step has no sample.

        Args:
            samples: The samples of a step.
            expected: Motion that the actuators are expected to cause in the step.
            bias: Estimated bias of the accelerometers [m/s^2], shape (3,).
            duration: Duration of the step [s].
        """
        if not samples:
            self._rate.interrupt()
            return None
        noise, count = self._noise, np.sqrt(len(samples))
        middle = sum(sample.time for sample in samples) / len(samples)
        acceleration = np.mean([sample.acceleration for sample in samples], axis=0)
        rate = np.mean([sample.rate for sample in samples], axis=0)
        sigma = float(np.hypot(expected.sigma[0], noise.acceleration_bias))
        self._acceleration.predict(0.0, expected.mean[:3], sigma)
        self._acceleration.measure(acceleration - bias, noise.acceleration / count)
        before, before_sigma, remaining = self._rest
        change = remaining * before + middle * expected.mean[3:]
        rate_sigma = remaining * before_sigma + middle * expected.sigma[1]
        self._rate.predict(1.0, change, rate_sigma)
        self._rate.measure(rate, noise.rate / count)
        self._rest = expected.mean[3:], float(expected.sigma[1]), duration - middle
        if not (self._acceleration.variance or self._rate.variance):
            return None
        # The errors of the actuators and of the known bias are not independent from step to step.
        sigmas = np.sqrt([self._acceleration.variance + sigma**2, self._rate.variance + rate_sigma**2])
        return BiasJump(np.concatenate([self._acceleration.jump, self._rate.jump]), sigmas, duration)


def motion_of(known: TargetEstimate) -> Motion:
    """Return the motion of an estimate."""
    return Motion(known.time, known.orientation, known.angular_velocity, logits_of(known.ratios))


def covariance_at(known: TargetEstimate, time: float, turned: FloatArray | None = None) -> FloatArray:
    """Return the covariance of an estimate's tangent at another time, shape (8, 8).

    Args:
        known: The estimate.
        time: The time [s].
        turned: Rotation of the frame W by a drift of the gyroscopes since the estimate's time, ``int R_WB dt``, shape
            (3, 3) [s]; None to neglect it.
    """
    transition = motion_of(known).drifted(time, np.zeros((3, 3)) if turned is None else turned)
    both = np.block([[known.covariance, known.drift_covariance[:8]], [known.drift_covariance.T]])
    return np.asarray(transition @ both @ transition.T)


def departs(
    known: TargetEstimate, times: FloatArray, orientation: FloatArray, sigma: float, tolerance: float = 1.0
) -> bool:
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
        tolerance: Factor of the deviations that count; infinite for none.
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
    off, sigmas, angle, change = (tolerance * limit for limit in (_OFF_SIGMAS, _SIGMAS, _LEAST_ANGLE, _LEAST_RATE))
    if any(_size(one, of_attitude) < off for one in error[-OFF_FRAMES:]):
        return False
    is_turned = _size(attitude, of_attitude) > sigmas and np.linalg.norm(attitude) > angle
    is_faster = _size(rate, of_rate) > sigmas and np.linalg.norm(rate) > change
    return bool(is_turned or is_faster)


def newest_motion(known: TargetEstimate, history: History, time: float) -> TargetEstimate:
    """Return the motion of the newest frames at a time [s]; the axes in the body are known and do not change.

    Args:
        known: The motion before; it is returned if there are less than two frames.
        history: The frames.
        time: The time [s].
    """
    times, q_WG = history.in_inertial  # noqa: N806
    if len(times) < 2:
        return known
    first = min(int(np.searchsorted(times, times[-1] - QUICK_SPAN - 1e-9)), len(times) - 2)
    turn = log(multiply(conjugate(q_WG[first]), q_WG[-1])) / (times[-1] - times[first])
    sigmas = np.repeat([*_QUICK_SIGMA, np.sqrt(known.covariance[6, 6] + known.covariance[7, 7])], [3, 3, 2])
    return replace(
        known,
        time=time,
        orientation=multiply(q_WG[-1], known.q_GT),
        angular_velocity=rotate(conjugate(known.q_GT), turn),
        covariance=np.diag(sigmas**2),
        drift_covariance=np.concatenate((np.zeros((8, 3)), known.drift_covariance[8:])),
    )


def _size(error: FloatArray, covariance: FloatArray) -> float:
    """Return the length of an error in standard deviations."""
    return float(np.sqrt(error @ np.linalg.solve(covariance, error)))


def centre_innovation(graph: GraphEstimate, expected: FloatArray, edge: Edge) -> float:
    """Return the distance of the measured centre of mass in B from its expected position, in standard deviations.

    The standard deviation is that of one axis. The result is 0 if the distance cannot be determined: for an edge from a
    frame before the last one, or from a frame whose relative pose is not known.

    Args:
        graph: Estimate of the back end at the last frame.
        expected: T_WB of this frame from the inertial unit, shape (4, 4).
        edge: An edge to this frame.
    """
    arm = 0.0
    if edge.first == MODEL:
        seen = inverse(edge.pose)[:3, 3]
    elif edge.first == graph.frame and graph.relative is not None:
        relative = graph.relative @ edge.pose
        seen = relative[:3, :3].T @ (graph.centre_glued - relative[:3, 3])
        arm = float(seen @ seen * np.linalg.eigvalsh(edge.covariance[:3, :3])[-1])
    else:
        return 0.0
    difference = seen - expected[:3, :3].T @ (graph.centre - expected[:3, 3])
    covariance = graph.centre_covariance + edge.covariance[3:, 3:] + graph.velocity_covariance + arm * np.eye(3)
    return float(np.sqrt(difference @ np.linalg.solve(covariance, difference) / 3.0))
