"""Bounds of the reference's error from trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.plugins.functor import misplaced
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.trials import BoundQuery, ErrorSamples, sample_errors
from safe_inspect.types import BoolArray, FloatArray

#: Default number of trials from which the scale of a conformal bound is computed.
_SCALE_TRIALS = 100


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
        if self.trials < needed:
            message = f"{self.epsilon:g} needs {needed} trials, and `trials` is {self.trials}; raise one of the two"
            raise misplaced([(("epsilon",), message)])
        return self

    def __call__(self, query: BoundQuery, streams: Streams) -> Bound:
        """Return the bound at the samples of the plan, using the random streams of one mission."""
        trials = trial_streams(streams, self.trials + _SCALE_TRIALS)
        return conformal_bound(sample_errors(query, trials), self.epsilon)


def trial_streams(streams: Streams, trials: int) -> Streams:
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
