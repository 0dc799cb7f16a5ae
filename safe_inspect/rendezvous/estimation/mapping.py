"""Estimation for a target of unknown shape: odometry, a map of what was seen, and registration to this map."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.quaternion import rotate, to_matrix
from safe_inspect.plugins.functor import functor_field
from safe_inspect.rendezvous.depth_camera import no_frame
from safe_inspect.rendezvous.estimate import BodyState, StateEstimate, unknown_estimate
from safe_inspect.rendezvous.estimation.estimators import (
    EstimatorContext,
    PipelineEstimator,
    PipelineEstimatorRun,
    StateEstimator,
)
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline
from safe_inspect.rendezvous.estimation.states import largest_sigma
from safe_inspect.rendezvous.estimation.surface_map import SurfaceMap
from safe_inspect.rendezvous.front_end.model import ModelFrontEnd
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import inverse, move, pose
from safe_inspect.rendezvous.readings import Reading, Readings
from safe_inspect.rendezvous.target.model import Target, TriangleMesh
from safe_inspect.rendezvous.target.solid import MeshSolid
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration, PositiveDuration, PositiveLength

#: Standard deviation of the map's origin from the centre of mass [m].
_CENTRE = 0.03
#: Misfit of the motion above which no map is made, in standard deviations, and the time until the next attempt [s].
_LARGEST_MISFIT, _AGAIN = 3.0, 30.0
#: Standard deviation of the attitude above which no map is made [rad], and the longest time without a pose to the map
#: while frames are registered to it again [s].
_LARGEST_ATTITUDE, _LOST = np.deg2rad(5.0), 8.0
#: Time constant of keeping the distance from what is seen [s].
_STATION = 100.0
#: Distance of the mating point from the centre before it is marked [m]: the camera looks at the centre.
_UNMARKED = 1e-3


class MappingEstimator(StateEstimator):
    """Estimator for a target of unknown shape that maps it during the observation.

    A front end for unknown shapes and a fit of the motion give the poses of the frames, and these a map. The frames are
    then registered to the map as to a known model, twice: the first time improves the poses for a second map. From then
    on the estimate comes from registration to this map. The mating point is the one that an operator marks in frames.

    Attributes:
        front_end: Computes relative poses from frames before there is a map.
        model_front_end: Registers frames to the map.
        radius: Radius of a sphere about the centre of mass that is known to contain the target [m].
        duration: Time after which the map is made [s].
        computing_time: Time that the flight computer takes for the map [s]; the estimate is used after it.
        correlation: Correlation of the errors of two consecutive updates.
    """

    front_end: Annotated[
        functor_field("front_end"),  # type: ignore[valid-type]
        Field(default="GicpSubmapFrontEnd", validate_default=True),
    ]
    model_front_end: ModelFrontEnd = ModelFrontEnd()
    radius: PositiveLength = 1.0  # type: ignore[valid-type]
    duration: PositiveDuration = 150.0  # type: ignore[valid-type]
    computing_time: NonNegativeDuration = 30.0  # type: ignore[valid-type]
    correlation: float = Field(default=0.9, ge=0.0, lt=1.0)

    @property
    def reads(self) -> tuple[Reading, ...]:
        """The kinds of measurements that the estimator reads."""
        return (self.front_end.reads, "inertial", "mark")

    def known(self, target: Target) -> Target:
        """Return a ball that contains the target."""
        ball = require("trimesh").creation.icosphere(subdivisions=3, radius=self.radius)
        surface = TriangleMesh(np.asarray(ball.vertices, np.float64), np.asarray(ball.faces, np.int64))
        return Target(MeshSolid([ball]), surface, np.eye(3), np.array([0.0, 0.0, _UNMARKED]))

    def __call__(self, context: EstimatorContext) -> _MappingEstimatorRun:
        """Return the estimator of a mission."""
        return _MappingEstimatorRun(context, self)


class _Station:
    """Motion of the chaser relative to what it sees, from the commands and the mean of the points of each frame.

    The mean moves about as the target turns, so that it corrects the motion slowly.

    Args:
        start: The chaser at the start.

    Attributes:
        position: Position of the chaser in W [m], shape (3,).
        velocity: Its velocity [m/s], shape (3,).
        centre: Mean of the points of the first frame in W [m], shape (3,); None before it.
    """

    def __init__(self, start: BodyState) -> None:
        self.position, self.velocity = start.position, start.velocity
        self.centre: FloatArray | None = None

    def advance(self, acceleration: FloatArray, step: float) -> None:
        """Advance by a step [s] with the commanded acceleration in W [m/s^2], shape (3,)."""
        self.position = self.position + step * self.velocity + 0.5 * step**2 * acceleration
        self.velocity = self.velocity + step * acceleration

    def correct(self, seen: FloatArray, period: float) -> None:
        """Correct the motion by the chaser's position from the mean of the points, in axes of W [m], shape (3,)."""
        if self.centre is None:
            self.centre = self.position - seen
        error = self.centre + seen - self.position
        self.position = self.position + min(2.0 * period / _STATION, 1.0) * error
        self.velocity = self.velocity + period / _STATION**2 * error


class _MappingEstimatorRun:
    """Estimator of one mission.

    Args:
        context: Context of the estimator.
        options: The options.
    """

    def __init__(self, context: EstimatorContext, options: MappingEstimator) -> None:
        self._context, self._options = context, options
        shared = {"correlation": options.correlation}
        odometry = PipelineEstimator(front_end=options.front_end, known_target=False, **shared)
        self._to_map = PipelineEstimator(
            front_end=options.model_front_end, back_end=ISAM2BackEnd(model_centre=_CENTRE), **shared
        )
        self._run: PipelineEstimatorRun = odometry(context)
        front_end = options.model_front_end
        noise = (float(front_end.range_sigma), float(front_end.range_growth))
        self._map = SurfaceMap(context.camera, context.T_BC, noise)
        self._readings: list[Readings] = []
        self._marks: list[tuple[int, FloatArray]] = []
        #: Times of the next attempt to make a map, and of the end of its computation [s].
        self._due, self._ready = options.duration, np.inf
        #: The map, and its origin in the frame of the map that frames are registered to.
        self._mapped: Target | None = None
        self._origin = np.zeros(3)

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        estimate = self._run.update(readings)
        if self._mapped is not None:
            return self._about_origin(estimate)
        self._keep(readings, estimate.chaser)
        pipeline = self._run.pipeline
        pipeline.expects_changes = False  # odometry errs more often than something strikes the target
        if readings.time >= self._due - 1e-9:
            self._due = readings.time + _AGAIN
            if _is_consistent(pipeline) and self._marks:
                self._due, self._ready = np.inf, readings.time + self._options.computing_time
        if readings.time >= self._ready - 1e-9:
            estimate = self._make_map(pipeline)
            if self._mapped is not None:
                return self._about_origin(estimate)
            self._due, self._ready = readings.time + _AGAIN, np.inf
        return self._not_mapped(estimate)

    def _not_mapped(self, estimate: StateEstimate) -> StateEstimate:
        """Return an estimate without a motion, by which the chaser keeps its distance from the points that it sees.

        Until the target has turned far enough, the graph's centre of mass may be off by half of the target's size, and
        the chaser's position with it.
        """
        position, velocity = self._station.position, self._station.velocity
        chaser = estimate.chaser._replace(position=position, velocity=velocity)
        known, centre = self._context.target.principal, self._station.centre
        return unknown_estimate(estimate.time, estimate.updated, chaser, known, estimate.correlation, centre)

    def _keep(self, readings: Readings, chaser: BodyState) -> None:
        """Keep readings for the map. Like the pipeline, count an empty frame if there is none at the start."""
        if readings.start is not None:
            self._station = _Station(readings.start)
        if readings.command is not None:
            force = rotate(chaser.orientation, readings.command.force)
            self._station.advance(force / self._context.chaser.mass, self._context.step)
        if readings.frame is not None and len(readings.frame.points):
            middle = move(self._context.T_BC, readings.frame.points.mean(axis=0, keepdims=True))[0]
            self._station.correct(-rotate(chaser.orientation, middle), self._context.frame_period)
        frame = readings.frame if self._readings or readings.frame is not None else no_frame(readings.time)
        self._readings.append(readings)
        if frame is not None:
            number = self._map.add(frame)
            if readings.mark is not None:
                self._marks.append((number, readings.mark))

    def _make_map(self, pipeline: EstimationPipeline) -> StateEstimate:
        """Make the map from all frames, register them to it, and do so again with the poses that this gives."""
        for _ in range(2):
            model, start = self._map_of(pipeline)
            run = PipelineEstimatorRun(replace(self._context, target=model), self._to_map, start)
            for readings in self._readings:
                estimate = run.update(readings)
                run.pipeline.expects_changes = False
                if readings.time > run.pipeline.updated + _LOST:
                    return estimate
            pipeline = run.pipeline
            if not _is_consistent(pipeline) or pipeline.graph.model is None:
                return estimate
        T_MG, poses = inverse(pipeline.graph.model), pipeline.motion_poses()  # noqa: N806
        marks = [move(T_MG @ poses[number], mark[None])[0] for number, mark in self._marks if number in poses]
        if not marks:
            return estimate
        self._origin = _centre_in_map(pipeline)
        mating_point = model.R_MT.T @ (np.median(marks, axis=0) - self._origin)
        mesh = TriangleMesh(model.mesh.vertices - self._origin, model.mesh.faces)
        self._mapped = Target(model.solid.moved(-self._origin), mesh, model.inertia, mating_point)
        self._run, pipeline.expects_changes = run, True
        self._readings.clear()
        return estimate

    def _map_of(self, pipeline: EstimationPipeline) -> tuple[Target, FloatArray | None]:
        """Return the map of all frames with the motion that a pipeline has found, and T_MB of the first frame.

        The origin of the map is the centre of mass.
        """
        poses, centre, motion = pipeline.motion_poses(), pipeline.graph.centre_glued, pipeline.target
        surface = self._map.surface(poses)
        axes = to_matrix(motion.q_GT)
        inertia = axes @ np.diag(motion.inertia) @ axes.T
        mesh = TriangleMesh(surface.vertices - centre, surface.faces)
        solid = self._map.solid(poses, surface, centre)
        first = poses.get(0)
        start = None if first is None else pose(first[:3, :3], first[:3, 3] - centre)
        return Target(solid, mesh, 0.5 * (inertia + inertia.T), self._context.target.mating_point), start

    def _about_origin(self, estimate: StateEstimate) -> StateEstimate:
        """Return an estimate of the position of the point of the map that was the centre of mass when it was made."""
        target, offset = estimate.target, self._origin - _centre_in_map(self._run.pipeline)
        position = target.position + rotate(target.orientation, self._mapped.R_MT.T @ offset)
        return replace(estimate, target=target._replace(position=position), mapped=self._mapped)


def _centre_in_map(pipeline: EstimationPipeline) -> FloatArray:
    """Return the centre of mass in the frame M of the map [m], shape (3,)."""
    return move(inverse(pipeline.graph.model), pipeline.graph.centre_glued[None])[0]


def _is_consistent(pipeline: EstimationPipeline) -> bool:
    """Return whether the motion is known and agrees with the poses."""
    found = pipeline.target
    if found is None or pipeline.graph is None:
        return False
    return found.misfit < _LARGEST_MISFIT and largest_sigma(found.covariance[:3, :3]) < _LARGEST_ATTITUDE
