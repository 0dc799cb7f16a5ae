"""Bounds of the reference's error from trials, in which estimates are sampled and propagated as the chaser would."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.dynamics import quaternion
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.plugins.functor import misplaced
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.estimate import EstimateErrors, JointErrors
from safe_inspect.rendezvous.estimation.states import inertia_of, logits_of
from safe_inspect.rendezvous.planner.problem import Path, to_inertial
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Additions that make a covariance positive definite: a fraction of its diagonal, and a minimum for each error.
_ROUNDING, _FLOOR = 1e-9, np.full(14, 1e-18)


@dataclass(frozen=True, eq=False)
class BoundQuery:
    """Query for the bound of the difference between the estimated and the true reference.

    Attributes:
        plan: The plan, with its path in T and the predicted motion of the target.
        inertia: The target's principal moments J1 <= J2 <= J3, up to a common factor, shape (3,).
        errors: Errors of an estimate.
        period: Time T_u from one update of the estimate to the next [s], a multiple of the plan's step; None for one
            estimate at the start that is propagated to the end.
        correlation: Correlation rho of the errors of two successive updates, at least 0 and less than 1.
        mass: Mass of the chaser [kg].
    """

    plan: Plan
    inertia: FloatArray
    errors: EstimateErrors
    period: float | None = 1.0
    correlation: float = 0.0
    mass: float = 9.583788668

    @property
    def step(self) -> float:
        """Time between two samples of the plan [s]."""
        return float((self.plan.times[-1] - self.plan.times[0]) / (len(self.plan.times) - 1))

    def windows(self) -> tuple[int, int]:
        """Return the number of estimates, and the number of the plan's steps between two."""
        steps = len(self.plan.times)
        if self.period is None:
            return 1, steps
        period = round(self.period / self.step)
        return int(np.ceil(steps / period)), period


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """Errors of the reference minus those of the chaser's navigation, in n trials, along the axes of W.

    Attributes:
        times: Times of the plan [s], shape (K,).
        position: Errors of the position [m], shape (n, K, 3).
        velocity: Errors of the velocity [m/s], shape (n, K, 3).
        force: Mass times the error of the acceleration [N], shape (n, K, 3).
    """

    times: FloatArray
    position: FloatArray
    velocity: FloatArray
    force: FloatArray

    @property
    def errors(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The errors of position, velocity and force."""
        return self.position, self.velocity, self.force

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, trials: slice | IntArray) -> ErrorSamples:
        """Return some of the trials."""
        return ErrorSamples(self.times, *(error[trials] for error in self.errors))


class _Draws(NamedTuple):
    """Sampled errors of n trials with E estimates each, shape (n, E, 3); the last two have shape (n, 2) and (n, 3)."""

    attitude: FloatArray
    rate: FloatArray
    centre: FloatArray
    position: FloatArray
    velocity: FloatArray
    inertia: FloatArray
    offset: FloatArray


def sample_errors(query: BoundQuery, streams: Streams) -> ErrorSamples:
    """Return trials of the reference's error ``delta = (r_hat - r) - (x_hat - x)``.

    At each update the target's state on the plan is disturbed, ``R Exp(attitude error)``, ``w + rate error``, and
    propagated without torque until the next update is in use. The errors of successive updates form
    an AR(1) sequence, ``e_{j+1} = rho e_j + sqrt(1 - rho^2) e``. Without updates, the first estimate is propagated to
    the end. Errors of the inertia are constant during a trial, and so is the offset of the centre of mass, about which
    the point that is taken for it rotates from one update to the next.

    Args:
        query: The plan, and the errors and updates of the estimates.
        streams: Random streams with one row per trial.
    """
    estimates, period = query.windows()
    steps = len(query.plan.times)
    draws = _draw(query.errors, query.correlation, estimates, streams)
    # The last row has no error; it is the reference for the others.
    draws = _Draws(*(np.concatenate((value, np.zeros_like(value[:1]))) for value in draws))
    length = min(period + 1, steps)
    errors = _windows(query, draws, period, length)
    window, offset = np.divmod(np.arange(steps), period)
    return ErrorSamples(query.plan.times, *(error[:, window, offset] for error in errors))


def _windows(query: BoundQuery, draws: _Draws, period: int, length: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the errors of each estimate while it may be in use, shape (n, E, length, 3) each."""
    plan = query.plan
    rows, estimates = draws.attitude.shape[:2]
    start = np.arange(estimates) * period
    turn = quaternion.exp(draws.attitude)
    orientation = quaternion.multiply(plan.orientation[start], turn)
    rate = np.broadcast_to(plan.angular_velocity[start], draws.rate.shape)
    if isinstance(query.errors, JointErrors):
        rate = quaternion.rotate(quaternion.conjugate(turn), rate)
    rate = rate + draws.rate
    inertia = np.repeat(_inertia(query.inertia, draws.inertia), estimates, axis=0)
    since = query.step * np.arange(length, dtype=np.float64)
    q, w = tumble(inertia, orientation.reshape(-1, 4), rate.reshape(-1, 3), since)
    k = np.minimum(start[:, None] + np.arange(length), len(plan.times) - 1)
    path = Path(plan.position_target[k], plan.velocity_target[k], plan.acceleration_target[k])
    shape = (rows, estimates, length)
    inertia, q, w = inertia.reshape(rows, estimates, 1, 3), q.reshape(*shape, 4), w.reshape(*shape, 3)
    reference = to_inertial(inertia, q, w, path, (draws.centre - draws.position)[:, :, None])
    position, velocity, acceleration = (value[:-1] - value[-1] for value in reference)
    if draws.offset.any():
        # The point that is taken for the centre rotates about the true one from the estimate on.
        still = np.zeros_like(draws.offset[:-1, None, None])
        about = Path(draws.offset[:-1, None, None], still, still)
        moved = to_inertial(inertia[-1], q[-1], w[-1], about)
        position = position + moved.position - moved.position[:, :, :1]
        velocity, acceleration = velocity + moved.velocity, acceleration + moved.acceleration
    return position, velocity - draws.velocity[:-1, :, None], query.mass * acceleration


def _draw(errors: EstimateErrors, correlation: float, estimates: int, streams: Streams) -> _Draws:
    def sequence(purpose: str, deviation: float, size: int = 3) -> FloatArray:
        if deviation == 0.0:
            return np.zeros((len(streams), estimates, size))
        values = streams.normal(f"bound.{purpose}", size * estimates).reshape(-1, estimates, size)
        values[:, 1:] *= np.sqrt(1.0 - correlation * correlation)
        for j in range(1, estimates):
            values[:, j] += correlation * values[:, j - 1]
        return deviation * values

    if isinstance(errors, JointErrors):
        # The logits come first: they have one error per trial, and the errors that are correlated with it depend on it.
        root = np.linalg.cholesky(errors.joint + _ROUNDING * np.diag(np.diag(errors.joint)) + np.diag(_FLOOR))
        logits = np.repeat(streams.normal("bound.inertia", 2)[:, None], estimates, axis=1)
        drawn = np.concatenate((logits, sequence("joint", 1.0, 12)), axis=2) @ root.T
        zero = np.zeros_like(drawn[..., :3])
        offset = zero[:, 0]
        if errors.offset.any():
            offset = streams.normal("bound.offset", 3) @ np.linalg.cholesky(errors.offset + _FLOOR[0] * np.eye(3)).T
        vectors = (drawn[..., 2:5], drawn[..., 5:8], drawn[..., 8:11], zero, drawn[..., 11:14])
        return _Draws(*vectors, inertia=drawn[:, 0, :2], offset=offset)
    inertia = errors.inertia * streams.normal("bound.inertia", 2) if errors.inertia else np.zeros((len(streams), 2))
    own = {name: sequence(name, getattr(errors, name)) for name in _Draws._fields[:-2]}
    return _Draws(**own, inertia=inertia, offset=np.zeros((len(streams), 3)))


def _inertia(inertia: FloatArray, logits: FloatArray) -> FloatArray:
    """Return inertias with disturbed logits, shape (n, 3).

    J = (k1, k2, 1) is always that of a rigid body, in ascending order; see `ratios_of`.

    Args:
        inertia: Principal moments, shape (3,).
        logits: Errors of the logits a and b, shape (n, 2).
    """
    inertia = np.asarray(inertia, dtype=float)
    if not logits.any():
        return np.tile(inertia, (len(logits), 1))
    disturbed = inertia_of(logits_of(inertia[:2] / inertia[2]) + logits)
    return np.where(logits.any(axis=1, keepdims=True), disturbed, inertia / inertia[2])


#: Default number of trials from which the scale of a conformal bound is computed.
_SCALE_TRIALS = 100
#: Largest number of trials of a bound, whose samples are kept in memory.
_MOST_TRIALS = 20_000


@dataclass(frozen=True, eq=False)
class Bound:
    """Bound of the difference between the estimated and the true reference, along each axis of W.

    Attributes:
        times: Times of the plan [s], shape (K,).
        position: Bound b_p of the position [m], shape (K,).
        velocity: Bound b_v of the velocity [m/s], shape (K,).
        force: Bound b_F of the feed-forward force [N], shape (K,).
        level: Probability that a new trial is within the bounds of position, velocity and force at all times.
        trials: Number of trials from which the bound is computed.
    """

    times: FloatArray
    position: FloatArray
    velocity: FloatArray
    force: FloatArray
    level: float
    trials: int

    def covers(self, samples: ErrorSamples) -> BoolArray:
        """Return for each trial whether it is within all bounds at all times and on all axes, shape (n,)."""
        return np.asarray(_scores(samples, (self.position, self.velocity, self.force)) <= 1.0)


class ConformalBound(Plugin):
    """Bound that holds jointly for position, velocity and force at all times, with a given probability.

    Attributes:
        epsilon: Probability that the bound is violated.
        trials: Number of trials, in addition to 100 that determine the shape of the bound over time.
    """

    epsilon: float = Field(default=0.05, gt=0.0, lt=1.0)
    trials: int = Field(default=200, ge=1)

    @model_validator(mode="after")
    def _has_trials(self) -> ConformalBound:
        needed = math.ceil(1.0 / self.epsilon - 1e-9) - 1
        if self.trials > _MOST_TRIALS:
            raise misplaced([(("trials",), f"{self.trials} trials are more than {_MOST_TRIALS:,}; lower it")])
        if self.trials < needed:
            message = f"{self.epsilon:g} needs {needed} trials, and `trials` is {self.trials}; raise one of the two"
            raise misplaced([(("epsilon",), message)])
        return self

    def __call__(self, query: BoundQuery, streams: Streams) -> Bound:
        """Return the bound at the samples of the plan, using the random streams of one mission."""
        trials = _trial_streams(streams, self.trials + _SCALE_TRIALS)
        return conformal_bound(sample_errors(query, trials), self.epsilon)


def _trial_streams(streams: Streams, trials: int) -> Streams:
    """Return random streams with one row for each trial of a mission."""
    return Streams(streams.seed, np.repeat(streams.slot, trials), np.arange(trials))


def conformal_bound(samples: ErrorSamples, epsilon: float = 0.05, scale_trials: int = _SCALE_TRIALS) -> Bound:
    """Return a bound that holds for a whole new trial with probability 1 - epsilon or more.

    The first trials give the root mean square error at each time, sigma_p(t), sigma_v(t) and sigma_F(t). Each of the n
    others has one score, ``s = max |delta| / sigma`` over times, axes and quantities. With the scores in ascending
    order, the bound is ``s_(ceil((n + 1)(1 - epsilon))) sigma(t)``.

    Args:
        samples: The trials, which must be exchangeable; enough of them for this epsilon, see `ConformalBound`.
        epsilon: Probability that the bound is violated.
        scale_trials: Number of trials that determine the scale.

    Raises:
        ValueError: A quantity has no error in the trials for the scale, and one in others.

    Source:
        Vovk, Gammerman and Shafer, "Algorithmic Learning in a Random World", 2005 (split conformal prediction).
    """
    count = len(samples) - scale_trials
    rank = math.ceil((count + 1) * (1.0 - epsilon) - 1e-9)
    scale, rest = samples[:scale_trials], samples[scale_trials:]
    sigmas = [np.sqrt((values * values).mean(axis=(0, 2))) for values in scale.errors]
    score = np.sort(_scores(rest, sigmas))[rank - 1]
    if not np.isfinite(score):
        raise ValueError("conformal bound: an error is zero in all trials of the scale but not in others")
    position, velocity, force = (score * sigma for sigma in sigmas)
    return Bound(samples.times, position, velocity, force, rank / (count + 1), len(samples))


def _scores(samples: ErrorSamples, scales: Sequence[FloatArray]) -> FloatArray:
    """Return for each trial the largest ratio of error to scale, shape (n,); 0 / 0 counts as 0."""
    score = np.zeros(len(samples))
    for values, scale in zip(samples.errors, scales, strict=True):
        error = np.abs(values).max(axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(error > 0.0, error / scale, 0.0)
        score = np.maximum(score, ratio.max(axis=1, initial=0.0))
    return score
