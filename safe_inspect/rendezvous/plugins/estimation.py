"""The estimator of a mission that sees by depth frames and an inertial unit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field, field_validator

from safe_inspect.plugins.functor import functor_field
from safe_inspect.rendezvous.back_end.isam2 import ISAM2BackEnd
from safe_inspect.rendezvous.characterise.motion import PolhodeCharacteriser
from safe_inspect.rendezvous.estimate import EstimatorContext
from safe_inspect.rendezvous.estimation.pipeline import PipelineParts
from safe_inspect.rendezvous.estimation.run import PipelineEstimatorRun, RunOptions, TruePose
from safe_inspect.rendezvous.estimation.suite import SensorSuite
from safe_inspect.rendezvous.front_end.context import FrontEndContext
from safe_inspect.rendezvous.models import MissionConfig
from safe_inspect.rendezvous.plugins.base import StateEstimator
from safe_inspect.rendezvous.sensors.imu import ImuNoise, checked_noise
from safe_inspect.rendezvous.sensors.tof import TimeOfFlightCamera
from safe_inspect.units import PositiveDuration


class PipelineEstimator(StateEstimator):
    """Knows what depth frames and an inertial unit tell.

    Attributes:
        camera: The depth camera.
        front_end: From frames to relative poses.
        back_end: From relative poses and inertial samples to states.
        characteriser: From the history to the target's motion.
        imu: Errors of the inertial unit.
        imu_ticks: Ticks of the truth between its samples.
        frame_period: Time between two frames [s], a multiple of the step of control.
        correlation: Correlation of the errors of two updates that follow each other.
        known_target: Whether the target's shape and inertia are known.
    """

    camera: TimeOfFlightCamera = TimeOfFlightCamera()
    front_end: Annotated[
        functor_field("front_end"),  # type: ignore[valid-type]
        Field(default="ModelFrontEnd", validate_default=True),
    ]
    back_end: ISAM2BackEnd = ISAM2BackEnd()
    characteriser: PolhodeCharacteriser = PolhodeCharacteriser()
    imu: ImuNoise = ImuNoise()
    imu_ticks: int = Field(default=2, ge=1)
    frame_period: PositiveDuration = 1.0  # type: ignore[valid-type]
    correlation: float = Field(default=0.9, ge=0.0, lt=1.0)
    known_target: bool = True

    _check_imu = field_validator("imu")(checked_noise)

    def misfits(self, mission: MissionConfig) -> Iterator[tuple[str, str]]:
        """Yield the name of each field that does not fit the rates of a mission, and why."""
        steps = round(self.frame_period / mission.step)
        if steps < 1 or abs(steps * mission.step - self.frame_period) > 1e-9:
            yield (
                "frame_period",
                f"{self.frame_period:g} s is no multiple of the step of control, {mission.step:g} s; round it",
            )
        if self.imu_ticks > mission.control_ticks:
            yield (
                "imu_ticks",
                f"{self.imu_ticks} ticks between two inertial samples are more than a step of control has, "
                f"{mission.control_ticks}; lower it",
            )

    def __call__(self, context: EstimatorContext) -> PipelineEstimatorRun:
        """Return the estimator of a mission."""
        steps = round(self.frame_period / context.step)
        sensors = SensorSuite(context, self.camera, self.imu, self.imu_ticks, render=self.front_end.needs_frames)
        target = context.target if self.known_target else None
        pose = TruePose()
        truth = None if self.front_end.needs_frames else pose
        seen = FrontEndContext(self.camera.geometry, sensors.T_BC, target, context.streams, truth)
        parts = PipelineParts(
            front_end=self.front_end(seen),
            back_end=lambda start, centre: self.back_end(self.imu, sensors.period, start, centre),
            characterise=self.characteriser,
            target=target,
            T_BC=sensors.T_BC,
            imu=self.imu,
        )
        return PipelineEstimatorRun(context, sensors, parts, RunOptions(steps, self.correlation), pose)
