"""The plugin kind of estimators: immutable options whose call builds the estimator of one mission."""

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
        """Return the newest estimate; called once for each control step.

        Args:
            readings: The measurements since the last call.
        """


class StateEstimator(Plugin):
    """Base class of estimators of the states of chaser and target."""

    kind: ClassVar[str] = "state_estimator"

    @abstractmethod
    def __call__(self, context: EstimatorContext) -> EstimatorRun:
        """Return the estimator of a mission."""

    @property
    def reads(self) -> tuple[Reading, ...]:
        """The kinds of measurements that the estimator reads; the others are not simulated."""
        return ("frames", "inertial")
