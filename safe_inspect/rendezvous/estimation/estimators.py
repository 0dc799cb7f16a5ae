"""Estimators: the plugin kind, its context, one for measured states, and one for frames and inertial samples."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Protocol

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.quaternion import exp, from_matrix, multiply, to_matrix
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthCamera, DepthFrame, no_frame
from safe_inspect.rendezvous.estimate import (
    UNKNOWN,
    BodyState,
    EstimateErrors,
    JointErrors,
    StateEstimate,
    unknown_estimate,
)
from safe_inspect.rendezvous.estimation.change import ActuatorResponse, covariance_at
from safe_inspect.rendezvous.estimation.characteriser import PolhodeCharacteriser
from safe_inspect.rendezvous.estimation.factors import ImuBuffer
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline
from safe_inspect.rendezvous.estimation.states import ChaserStart, GraphEstimate, TargetEstimate, largest_sigma
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.models import ChaserConfig
from safe_inspect.rendezvous.poses import pose
from safe_inspect.rendezvous.readings import Reading, Readings
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: A motion is first accepted when the standard deviation of its attitude is below this [rad]. A covariance describes
#: only rotations close to the estimate: fits of a few seconds with strong noise can have the target turn the other way.
_FIRST_ATTITUDE = np.deg2rad(10.0)
#: Time before the end of kept readings from which the motion is fitted [s].
_FITTED = 10.0


@dataclass(frozen=True, eq=False)
class EstimatorContext:
    """Properties of chaser, target and sensors that are known before a mission.

    Attributes:
        target: The target.
        chaser: The chaser: its mass, inertia, and documented errors of its actuators.
        step: Control period, at which an estimator is called [s].
        camera: Geometry of the depth camera.
        T_BC: Pose of the camera in B, shape (4, 4).
        frame_period: Time between two frames [s].
        imu: Errors of the inertial unit.
        imu_period: Time between two of its samples [s].
        streams: Random streams that only the estimator uses.
        length: Length of the scenario [m].
    """

    target: Target
    chaser: ChaserConfig
    step: float
    camera: DepthCamera
    T_BC: FloatArray
    frame_period: float
    imu: ImuNoise
    imu_period: float
    streams: Streams
    length: float = 1.0

    def in_units_of(self, length: float) -> EstimatorContext:
        """Return the context with all lengths divided by a length [m]; those of torque and inertia cancel."""
        chaser, actuator = self.chaser, self.chaser.actuator
        noise = {"force_noise": actuator.force_noise / length}
        return replace(
            self,
            target=self.target.in_units_of(length),
            chaser=chaser.model_copy(update={"actuator": actuator.model_copy(update=noise)}),
            camera=self.camera.in_units_of(length),
            T_BC=pose(self.T_BC[:3, :3], self.T_BC[:3, 3] / length),
            imu=self.imu.in_units_of(length),
            length=self.length / length,
        )


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

    def known(self, target: Target) -> Target:
        """Return what estimator and pilot know of a target before the mission: by default everything."""
        return target


class _ScaledRun:
    """Estimator of one mission that computes in units of the scenario's length.

    Distances, tolerances and errors that suit a scenario of 1 m then suit one of any size.

    Args:
        run: The estimator, whose context has lengths in these units.
        length: Length of the scenario [m].
    """

    def __init__(self, run: EstimatorRun, length: float) -> None:
        self._run, self._length = run, length

    @classmethod
    def of(cls, start: Callable[[EstimatorContext], EstimatorRun], context: EstimatorContext) -> EstimatorRun:
        """Return the estimator of a mission that `start` returns for a context, in units of the scenario's length."""
        length = context.length
        return start(context) if length == 1.0 else cls(start(context.in_units_of(length)), length)

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        return self._run.update(readings.in_units_of(self._length)).in_units_of(1.0 / self._length)


class _MeasuredStateRun:
    """Estimator of one mission; between two measurements it predicts the target as a free body.

    Args:
        context: Context of the estimator.
    """

    def __init__(self, context: EstimatorContext) -> None:
        self._inertia, self._step = context.target.principal, context.step
        self._last: StateEstimate | None = None

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        time, state = readings.time, readings.state
        assert state is not None, "`MeasuredState.reads` requires the state"
        if state.target is not None:
            self._last = StateEstimate(
                time, time, state.chaser, state.target, self._inertia, state.errors, state.correlation
            )
        last = self._last
        if last is None:
            return unknown_estimate(time, 0.0, state.chaser, self._inertia, state.correlation)
        steps = float(round((time - last.time) / self._step))
        (q,), (w,) = last.predict(np.array([last.time + self._step * steps]))
        return replace(
            last, time=time, chaser=state.chaser, target=last.target._replace(orientation=q, angular_velocity=w)
        )


class MeasuredState(StateEstimator):
    """Estimator that returns the states measured by ``sensors.state``, with free motion of the target in between."""

    @property
    def reads(self) -> tuple[Reading, ...]:
        """The kinds of measurements that the estimator reads."""
        return ("state",)

    def __call__(self, context: EstimatorContext) -> _MeasuredStateRun:
        """Return the estimator of a mission."""
        return _MeasuredStateRun(context)


class PipelineEstimatorRun:
    """Estimator of one mission that runs the pipeline on its readings.

    Args:
        context: Context of the estimator.
        options: The options.
        poses: T_MB of the first frames, by their number, shape (4, 4) each; None if they must be searched.

    Attributes:
        front_end: The front end of the mission.
        pipeline: The pipeline; None before the first readings.
    """

    def __init__(
        self, context: EstimatorContext, options: PipelineEstimator, poses: Mapping[int, FloatArray] | None = None
    ) -> None:
        self._context, self._options = context, options
        target = context.target if options.known_target else None
        self._seen = FrontEndContext(context.camera, context.T_BC, target, context.streams, poses or {})
        self.front_end = options.front_end(self._seen)
        self.pipeline: EstimationPipeline | None = None
        self._response = ActuatorResponse(context.chaser, context.step)
        self._errors, self._renewed = UNKNOWN, -np.inf
        self._rate = np.zeros(3)
        #: The newest estimate of the motion, and the rotation of W by a drift of the gyroscopes since its time [s].
        self._found: TargetEstimate | None = None
        self._turned, self._reached = np.zeros((3, 3)), 0.0
        self._frame: DepthFrame | None = None

    def _begin(self, readings: Readings) -> EstimationPipeline:
        """Return the pipeline; it integrates the chaser's motion from the first readings on, even without a frame."""
        assert readings.start is not None, "the first readings contain the chaser's state"
        start = ChaserStart(
            pose(to_matrix(readings.start.orientation), readings.start.position), readings.start.velocity
        )
        imu = ImuBuffer(self._context.imu, self._context.imu_period)
        parts = (self.front_end, self._options.back_end, self._options.characteriser)
        return EstimationPipeline(*parts, self._seen, imu, start, readings.frame or no_frame(readings.time))

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        is_due = readings.time >= self._renewed + self._context.frame_period - 1e-9 or self._frame is not None
        if self.pipeline is None:
            self.pipeline = self._begin(readings)
        else:
            # The flight computer needs up to a control step for a frame: its poses are known at the next one.
            if self._frame is not None:
                self.pipeline.see(self._frame)
            if readings.command is not None:
                expected = self._response.step(self._rate, readings.command)
                self.pipeline.move(readings.samples, expected, self._context.step)
            self._frame = readings.frame
        if is_due:
            self._renewed = readings.time
        estimate = self._estimate(self.pipeline, readings.time, renew=is_due)
        self._rate = estimate.chaser.angular_velocity
        return estimate

    def tolerate(self, factor: float) -> None:
        """Set the factor of the deviations of frames that mean that the motion has changed."""
        if self.pipeline is not None:
            self.pipeline.tolerance = factor

    def replay(self, kept: Sequence[Readings], longest: float) -> StateEstimate | None:
        """Return the estimate after readings that were kept; None if no frame gives a pose for a time [s].

        The motion is only fitted at the end. That it disagrees with frames is not taken as a change.
        """
        estimate = None
        for readings in kept:
            estimate = self.update(readings)
            self.tolerate(np.inf)
            if self.pipeline is not None:
                self.pipeline.fitted_from = kept[-1].time - _FITTED
            if readings.time > estimate.updated + longest:
                return None
        return estimate

    def _turned_since(self, found: TargetEstimate | None, rotation: FloatArray, time: float) -> FloatArray:
        """Return ``int R_WB dt`` since the time of an estimate, shape (3, 3) [s]."""
        if found is not self._found:
            self._found, self._turned = found, np.zeros((3, 3))
            self._reached = time if found is None else found.time
        self._turned, self._reached = self._turned + (time - self._reached) * rotation, time
        return self._turned

    def _estimate(self, pipeline: EstimationPipeline, time: float, *, renew: bool) -> StateEstimate:
        T_WB, velocity, rate = pipeline.now()  # noqa: N806
        chaser = BodyState(T_WB[:3, 3].copy(), velocity, from_matrix(T_WB[:3, :3]), rate)
        graph, found = pipeline.graph, pipeline.target
        turned = self._turned_since(found, T_WB[:3, :3], time)
        centre = np.zeros(3) if graph is None else graph.centre
        errors = UNKNOWN
        if graph is not None and found is not None:
            errors = _errors(found, graph, time, turned) if renew or self._errors is UNKNOWN else self._errors
            if self._errors is UNKNOWN and errors.attitude > _FIRST_ATTITUDE:
                errors = UNKNOWN
        self._errors = errors
        if graph is None or found is None or errors is UNKNOWN:
            inertia = self._context.target.principal
            return unknown_estimate(time, pipeline.updated, chaser, inertia, self._options.correlation, centre)
        q, w = found.predict(np.array([time]))
        problem = "" if found.aligned else "the directions of the target's axes are not known"
        alarm = "the target's motion has changed" if pipeline.changed else ""
        return StateEstimate(
            time=time,
            updated=pipeline.updated,
            chaser=chaser,
            target=BodyState(centre, np.zeros(3), multiply(exp(-turned @ found.drift), q[0]), w[0]),
            inertia=found.inertia,
            errors=errors,
            correlation=self._options.correlation,
            problem=alarm or problem,
            alarm=alarm,
            mismatch=pipeline.mismatch,
        )


def _errors(found: TargetEstimate, graph: GraphEstimate, time: float, turned: FloatArray) -> EstimateErrors:
    """Return the errors at a time: the joint covariance, and the largest standard deviation of each quantity."""
    covariance = covariance_at(found, time, turned)
    rotation = graph.chaser[:3, :3]
    centre = rotation @ graph.centre_covariance @ rotation.T
    joint = np.zeros((14, 14))
    order = [6, 7, 0, 1, 2, 3, 4, 5]
    joint[:8, :8] = covariance[np.ix_(order, order)]
    joint[8:11, 8:11], joint[11:, 11:] = centre, graph.velocity_covariance
    attitude, rate, inertia = (largest_sigma(covariance[k, k]) for k in (slice(3), slice(3, 6), slice(6, 8)))
    velocity = largest_sigma(graph.velocity_covariance)
    return JointErrors(attitude, rate, largest_sigma(centre), inertia, 0.0, velocity, 0.5 * (joint + joint.T))


class PipelineEstimator(StateEstimator):
    """Estimator from depth frames and an inertial unit, with a factor graph and a fit of the target's motion.

    It computes in units of ``mission.length``; lengths in its options are fractions of it.

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

    def __call__(self, context: EstimatorContext) -> EstimatorRun:
        """Return the estimator of a mission."""
        return _ScaledRun.of(lambda scaled: PipelineEstimatorRun(scaled, self), context)
