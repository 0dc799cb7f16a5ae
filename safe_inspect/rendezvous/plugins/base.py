"""The plugin kind of estimators: frozen recipes without memory that build the run of one mission."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Protocol

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.estimate import BodyState, EstimatorContext, InertialTruth, StateEstimate
from safe_inspect.rendezvous.models import MissionConfig


class EstimatorRun(Protocol):
    """The estimator of one mission."""

    def update(
        self,
        time: float,
        chaser: BodyState,
        target: BodyState,
        *,
        blind: bool = False,
        inertial: InertialTruth | None = None,
    ) -> StateEstimate:
        """Return the newest estimate.

        Args:
            time: The time [s].
            chaser: The chaser's true state, which sensors see.
            target: The target's true state.
            blind: Whether the camera gives nothing.
            inertial: What the inertial unit has felt since the last call; None before the first step.
        """


class StateEstimator(Plugin):
    """Base of estimators: what the chaser knows of itself and of the target."""

    kind: ClassVar[str] = "state_estimator"

    @abstractmethod
    def __call__(self, context: EstimatorContext) -> EstimatorRun:
        """Return the estimator of a mission."""

    def misfits(self, mission: MissionConfig) -> Iterator[tuple[str, str]]:
        """Yield the name of each field that does not fit the rates of a mission, and why."""
        yield from ()
