"""Bounds of the error of the reference, from trials."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.plugins.functor import misplaced
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.bound.query import least_trials
from safe_inspect.rendezvous.plugins.base import UncertaintyBound

if TYPE_CHECKING:
    from safe_inspect.rendezvous.bound.conformal import Bound
    from safe_inspect.rendezvous.bound.query import BoundQuery


class JointConformalBound(UncertaintyBound, name="ConformalBound"):
    """A bound that position, velocity and force keep together, at all times, with a stated probability.

    Attributes:
        epsilon: Probability that it is broken.
        trials: Number of trials, beside 100 that give its shape over time.
    """

    epsilon: float = Field(default=0.05, gt=0.0, lt=1.0)
    trials: int = Field(default=200, ge=1)

    @model_validator(mode="after")
    def _has_trials(self) -> JointConformalBound:
        needed = least_trials(self.epsilon)
        if self.trials < needed:
            message = f"{self.epsilon:g} needs {needed} trials, and `trials` is {self.trials}; raise one of the two"
            raise misplaced([(("epsilon",), message)])
        return self

    def __call__(self, query: BoundQuery, streams: Streams) -> Bound:
        """Return bounds at the samples of the plan."""
        from safe_inspect.rendezvous.bound.conformal import SCALE_TRIALS, conformal_bound
        from safe_inspect.rendezvous.bound.samples import sample_errors

        trials = self.trials + SCALE_TRIALS
        return conformal_bound(sample_errors(query, trial_streams(streams, trials)), self.epsilon, SCALE_TRIALS)


class MaxSampleBound(UncertaintyBound):
    """The largest error of some trials, at each time.

    Attributes:
        trials: Number of trials.
    """

    trials: int = Field(default=199, ge=1)

    def __call__(self, query: BoundQuery, streams: Streams) -> Bound:
        """Return bounds at the samples of the plan."""
        from safe_inspect.rendezvous.bound.conformal import max_sample_bound
        from safe_inspect.rendezvous.bound.samples import sample_errors

        return max_sample_bound(sample_errors(query, trial_streams(streams, self.trials)))


def trial_streams(streams: Streams, trials: int) -> Streams:
    """Return a stream for each trial of a mission."""
    return Streams(streams.seed, np.repeat(streams.slot, trials), np.arange(trials))
