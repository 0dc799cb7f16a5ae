"""The estimator that passes on measured states."""

from __future__ import annotations

from safe_inspect.rendezvous.estimation.context import EstimatorContext
from safe_inspect.rendezvous.estimation.measured import MeasuredStateRun
from safe_inspect.rendezvous.plugins.base import StateEstimator
from safe_inspect.rendezvous.readings import Reading


class MeasuredState(StateEstimator):
    """Knows the states that the sensor ``sensors.state`` measures; between two measurements the target moves freely."""

    @property
    def reads(self) -> tuple[Reading, ...]:
        """What it reads of the sensors."""
        return ("state",)

    def __call__(self, context: EstimatorContext) -> MeasuredStateRun:
        """Return the estimator of a mission."""
        return MeasuredStateRun(context)
