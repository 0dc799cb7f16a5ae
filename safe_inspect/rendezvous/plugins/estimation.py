"""The estimator that uses depth frames and an inertial unit."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from safe_inspect.plugins.functor import functor_field
from safe_inspect.rendezvous.back_end.isam2 import ISAM2BackEnd
from safe_inspect.rendezvous.characterise.motion import PolhodeCharacteriser
from safe_inspect.rendezvous.estimation.context import EstimatorContext
from safe_inspect.rendezvous.estimation.pipeline import PipelineParts
from safe_inspect.rendezvous.estimation.run import PipelineEstimatorRun
from safe_inspect.rendezvous.front_end.context import FrontEndContext
from safe_inspect.rendezvous.plugins.base import StateEstimator
from safe_inspect.rendezvous.readings import Reading


class PipelineEstimator(StateEstimator):
    """Estimator from depth frames and an inertial unit, with a factor graph and a fit of the target's motion.

    Attributes:
        front_end: Computes relative poses from frames.
        back_end: Estimates states from relative poses and inertial samples.
        characteriser: Estimates the target's motion from the history.
        correlation: Correlation of the errors of two consecutive updates.
        known_target: Whether the target's shape and inertia are known.
    """

    front_end: Annotated[
        functor_field("front_end"),  # type: ignore[valid-type]
        Field(default="ModelFrontEnd", validate_default=True),
    ]
    back_end: ISAM2BackEnd = ISAM2BackEnd()
    characteriser: PolhodeCharacteriser = PolhodeCharacteriser()
    correlation: float = Field(default=0.9, ge=0.0, lt=1.0)
    known_target: bool = True

    @property
    def reads(self) -> tuple[Reading, ...]:
        """The kinds of measurements that the estimator reads."""
        return (self.front_end.reads, "inertial")

    def __call__(self, context: EstimatorContext) -> PipelineEstimatorRun:
        """Return the estimator of a mission."""
        target = context.target if self.known_target else None
        parts = PipelineParts(
            front_end=self.front_end(FrontEndContext(context.camera, context.T_BC, target, context.streams)),
            back_end=lambda start, centre: self.back_end(context.imu, context.imu_period, start, centre),
            characterise=self.characteriser,
            target=target,
            T_BC=context.T_BC,
            imu=context.imu,
        )
        return PipelineEstimatorRun(context, parts, self.correlation)
