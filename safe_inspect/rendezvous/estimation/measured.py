"""Estimator that returns the states that a simulated sensor measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from safe_inspect.rendezvous.estimate import BodyState, StateEstimate, unknown_estimate
from safe_inspect.rendezvous.estimation.context import EstimatorContext
from safe_inspect.rendezvous.readings import Readings

#: Number of control steps for which the motion is predicted at once.
_PREDICTED = 5


class MeasuredStateRun:
    """Estimator of one mission; between two measurements it predicts the target as a free body.

    Args:
        context: Context of the estimator.
    """

    def __init__(self, context: EstimatorContext) -> None:
        self._inertia, self._step = context.target.principal, context.step
        self._last: StateEstimate | None = None
        # Prediction from the last measurement for a few calls, and the number of the first of these calls.
        self._first = -1
        self._predicted = (np.empty((0, 4)), np.empty((0, 3)))

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        time, state = readings.time, readings.state
        assert state is not None, "`MeasuredState.reads` requires the state"
        if state.target is not None:
            self._last = StateEstimate(
                time, time, state.chaser, state.target, self._inertia, state.errors, state.correlation
            )
            self._first = -1
        last = self._last
        if last is None:
            return unknown_estimate(time, 0.0, state.chaser, self._inertia, state.correlation)
        calls = round((time - last.time) / self._step)
        first = calls - calls % _PREDICTED
        if first != self._first:
            self._first = first
            steps = np.arange(first, first + _PREDICTED, dtype=np.float64)
            self._predicted = last.predict(last.time + self._step * steps)
        q, w = self._predicted[0][calls - first], self._predicted[1][calls - first]
        target = BodyState(last.target.position, last.target.velocity, q, w)
        return replace(last, time=time, chaser=state.chaser, target=target)
