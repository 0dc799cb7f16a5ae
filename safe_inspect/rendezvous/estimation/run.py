"""Estimator of a mission from depth frames and inertial samples."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import from_matrix, to_matrix
from safe_inspect.rendezvous.back_end.states import ChaserStart, GraphEstimate
from safe_inspect.rendezvous.bound.query import EstimateErrors, JointErrors
from safe_inspect.rendezvous.characterise.history import TargetEstimate
from safe_inspect.rendezvous.estimate import UNKNOWN, BodyState, StateEstimate, unknown_estimate
from safe_inspect.rendezvous.estimation.change import covariance_at
from safe_inspect.rendezvous.estimation.context import EstimatorContext
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline, PipelineParts
from safe_inspect.rendezvous.estimation.response import ActuatorResponse, ExpectedMotion
from safe_inspect.rendezvous.poses import pose
from safe_inspect.rendezvous.readings import Readings
from safe_inspect.rendezvous.sensors.imu import InertialSample
from safe_inspect.rendezvous.sensors.tof import no_frame
from safe_inspect.types import FloatArray

#: A motion is first accepted when the standard deviation of its attitude is below this [rad]. A covariance describes
#: only rotations close to the estimate: fits of a few seconds with strong noise can have the target turn the other way.
_FIRST_ATTITUDE = np.deg2rad(20.0)


class PipelineEstimatorRun:
    """Estimator of one mission that runs the pipeline on its readings.

    Args:
        context: Context of the estimator.
        parts: Components of the pipeline.
        correlation: Correlation of the errors of two consecutive updates.
    """

    def __init__(self, context: EstimatorContext, parts: PipelineParts, correlation: float) -> None:
        self._context, self._parts, self._correlation = context, parts, correlation
        self.pipeline: EstimationPipeline | None = None
        self._response = ActuatorResponse(context.chaser, context.step)
        self._errors, self._renewed = UNKNOWN, -np.inf
        self._rate = np.zeros(3)

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        if self.pipeline is None:
            assert readings.start is not None, "the first readings contain the chaser's state"
            at_start = pose(to_matrix(readings.start.orientation), readings.start.position)
            self.pipeline = EstimationPipeline(self._parts, ChaserStart(at_start, readings.start.velocity))
        if readings.command is not None:
            self._move(self.pipeline, self._response.step(self._rate, readings.command), readings.samples)
        if readings.frame is not None:
            self.pipeline.see(readings.frame)
        elif readings.start is not None:
            self.pipeline.see(no_frame(readings.time))  # the chaser's motion is integrated from here on
        is_due = readings.time >= self._renewed + self._context.frame_period - 1e-9
        if is_due:
            self._renewed = readings.time
        estimate = self._estimate(self.pipeline, readings.time, renew=is_due)
        self._rate = estimate.chaser.angular_velocity
        return estimate

    def _move(
        self, pipeline: EstimationPipeline, expected: ExpectedMotion, samples: tuple[InertialSample, ...]
    ) -> None:
        """Propagate a control step by the inertial unit, or by the command if the unit gives no samples."""
        if not samples:
            pipeline.coast(self._context.step, expected.mean)
            return
        pipeline.check_biases(samples, expected, self._context.step)
        for sample in samples:
            pipeline.measure(sample.acceleration, sample.rate, self._context.imu_period)

    def _estimate(self, pipeline: EstimationPipeline, time: float, *, renew: bool) -> StateEstimate:
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
            inertia = self._context.target.principal
            return unknown_estimate(time, pipeline.updated, chaser, inertia, self._correlation, centre)
        q, w = found.predict(np.array([time]))
        problem = "" if found.aligned else "the directions of the target's axes are not known"
        alarm = "the target's motion has changed" if pipeline.changed else ""
        return StateEstimate(
            time=time,
            updated=pipeline.updated,
            chaser=chaser,
            target=BodyState(centre, np.zeros(3), q[0], w[0]),
            inertia=found.inertia,
            errors=errors,
            correlation=self._correlation,
            problem=alarm or problem,
            alarm=alarm,
            mismatch=pipeline.mismatch,
        )


def _errors(found: TargetEstimate, graph: GraphEstimate, time: float) -> EstimateErrors:
    """Return the errors at a time: the joint covariance, and the largest standard deviation of each quantity."""
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
