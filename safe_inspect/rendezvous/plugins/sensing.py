"""The estimator that returns measured states."""

from __future__ import annotations

from safe_inspect.rendezvous.estimation.context import EstimatorContext
from safe_inspect.rendezvous.estimation.measured import MeasuredStateRun
from safe_inspect.rendezvous.plugins.base import StateEstimator
from safe_inspect.rendezvous.readings import Reading


class MeasuredState(StateEstimator):
    """Estimator that returns the states measured by ``sensors.state``, with free motion of the target in between."""

    @property
    def reads(self) -> tuple[Reading, ...]:
        """The kinds of measurements that the estimator reads."""
        return ("state",)

    def __call__(self, context: EstimatorContext) -> MeasuredStateRun:
        """Return the estimator of a mission."""
        return MeasuredStateRun(context)
