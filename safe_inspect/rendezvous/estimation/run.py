"""The estimator of a mission whose chaser knows what its sensors tell, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics.quaternion import from_matrix, to_matrix
from safe_inspect.rendezvous.back_end.states import ChaserStart, GraphEstimate
from safe_inspect.rendezvous.bound.query import EstimateErrors, JointErrors
from safe_inspect.rendezvous.characterise.history import TargetEstimate
from safe_inspect.rendezvous.estimate import BodyState, EstimatorContext, InertialTruth, StateEstimate
from safe_inspect.rendezvous.estimation.change import covariance_at
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline, PipelineParts
from safe_inspect.rendezvous.estimation.suite import SensorSuite
from safe_inspect.rendezvous.poses import pose
from safe_inspect.types import FloatArray

#: Errors of a target whose motion is not known yet [rad, rad/s, m].
UNKNOWN = EstimateErrors(attitude=np.pi, rate=1.0, centre=1.0, inertia=1.0, velocity=0.1)
#: A motion is first believed when its attitude's standard deviation is below this [rad]. A covariance describes
#: rotations near the estimate only: fits of a few seconds with harsh noise can have the target turn the other way.
_FIRST_ATTITUDE = np.deg2rad(20.0)


@dataclass(frozen=True)
class RunOptions:
    """How often the sensors are asked, and what is assumed of the errors.

    Attributes:
        frame_steps: Steps of control between two frames.
        correlation: Correlation of the errors of two updates that follow each other.
        needs_model: Whether a motion whose axes' directions no model has fixed may not be planned with.
    """

    frame_steps: int
    correlation: float
    needs_model: bool = True


class TruePose:
    """The true T_MB at the frame that is being processed, for front ends that are simulated."""

    def __init__(self) -> None:
        self.pose = np.eye(4)

    def __call__(self) -> FloatArray:
        """Return it, shape (4, 4)."""
        return self.pose


class PipelineEstimatorRun:
    """Simulated sensors, and the pipeline that they feed.

    Args:
        context: What the estimator is made with.
        sensors: The sensors.
        parts: The pipeline's parts.
        options: See `RunOptions`.
        true_pose: What a simulated front end sees.
    """

    def __init__(
        self,
        context: EstimatorContext,
        sensors: SensorSuite,
        parts: PipelineParts,
        options: RunOptions,
        true_pose: TruePose,
    ) -> None:
        self._context, self._sensors, self._parts, self._options = context, sensors, parts, options
        self.pipeline: EstimationPipeline | None = None
        self._true_pose = true_pose
        self._call = -1
        self._errors = UNKNOWN

    def update(
        self,
        time: float,
        chaser: BodyState,
        target: BodyState,
        *,
        blind: bool = False,
        inertial: InertialTruth | None = None,
    ) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        if self.pipeline is None:
            at_start = pose(to_matrix(chaser.orientation), chaser.position)
            self.pipeline = EstimationPipeline(self._parts, ChaserStart(at_start, chaser.velocity.copy()))
        pipeline, sensors = self.pipeline, self._sensors
        if inertial is not None:
            samples = sensors.samples(inertial)
            if inertial.expected is not None and not inertial.silent:
                pipeline.check_biases(samples, inertial.expected, self._context.step)
            for sample in samples:
                pipeline.measure(sample.acceleration, sample.rate, sensors.period)
            if inertial.silent:
                pipeline.coast(self._context.step, None if inertial.expected is None else inertial.expected.mean)
        call = round(time / self._context.step)
        is_frame = call % self._options.frame_steps == 0 and call != self._call
        self._call = call
        if is_frame:
            self._true_pose.pose = sensors.pose_in_model(chaser, target)
            frame = sensors.frame(time, chaser, target)
            if not blind:
                pipeline.see(frame)
        return self._estimate(time, renew=is_frame)

    def _estimate(self, time: float, *, renew: bool) -> StateEstimate:
        pipeline, options = self.pipeline, self._options
        assert pipeline is not None, "the pipeline starts with the first call"
        T_WB, velocity, rate = pipeline.now()  # noqa: N806
        chaser = BodyState(T_WB[:3, 3].copy(), velocity, from_matrix(T_WB[:3, :3]), rate)
        graph, found = pipeline.graph, pipeline.target
        centre = np.zeros(3) if graph is None else graph.centre
        errors = UNKNOWN
        if graph is not None and found is not None:
            errors = _errors(found, graph, time) if renew or self._errors is UNKNOWN else self._errors
            if self._errors is UNKNOWN and errors.attitude > _FIRST_ATTITUDE:
                errors = UNKNOWN
        self._errors = errors
        if graph is None or found is None or errors is UNKNOWN:
            problem = "the target's motion is not known yet"
            unknown = BodyState(centre, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))
            inertia = self._context.target.principal
            return StateEstimate(
                time, pipeline.updated, chaser, unknown, inertia, UNKNOWN, options.correlation, problem
            )
        q, w = found.predict(np.array([time]))
        problem = ""
        if options.needs_model and not found.aligned:
            problem = "the directions of the target's axes are not known"
        alarm = "the target's motion has changed" if pipeline.changed else ""
        return StateEstimate(
            time=time,
            updated=pipeline.updated,
            chaser=chaser,
            target=BodyState(centre, np.zeros(3), q[0], w[0]),
            inertia=found.inertia,
            errors=errors,
            correlation=options.correlation,
            problem=alarm or problem,
            alarm=alarm,
            mismatch=pipeline.mismatch,
        )


def _errors(found: TargetEstimate, graph: GraphEstimate, time: float) -> EstimateErrors:
    """Return the errors at a time: their covariance, and of each kind the largest standard deviation of a direction."""
    covariance = covariance_at(found, time)
    rotation = graph.chaser[:3, :3]
    centre = rotation @ graph.centre_covariance @ rotation.T
    joint = np.zeros((14, 14))
    order = [6, 7, 0, 1, 2, 3, 4, 5]
    joint[:8, :8] = covariance[np.ix_(order, order)]
    joint[8:11, 8:11], joint[11:, 11:] = centre, graph.velocity_covariance
    attitude, rate, inertia = (_largest(covariance[k, k]) for k in (slice(3), slice(3, 6), slice(6, 8)))
    return JointErrors(
        attitude, rate, _largest(centre), inertia, 0.0, _largest(graph.velocity_covariance), 0.5 * (joint + joint.T)
    )


def _largest(covariance: FloatArray) -> float:
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
