"""The plugin kind of estimators: frozen recipes without memory that build the run of one mission."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Protocol

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.estimation.context import EstimatorContext
from safe_inspect.rendezvous.readings import Reading, Readings


class EstimatorRun(Protocol):
    """The estimator of one mission."""

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; called once for each step of control.

        Args:
            readings: What the sensors have given since the last call.
        """


class StateEstimator(Plugin):
    """Base of estimators: what the chaser knows of itself and of the target."""

    kind: ClassVar[str] = "state_estimator"

    @abstractmethod
    def __call__(self, context: EstimatorContext) -> EstimatorRun:
        """Return the estimator of a mission."""

    @property
    def reads(self) -> tuple[Reading, ...]:
        """What it reads of the sensors; the others are not simulated."""
        return ("frames", "inertial")
