"""Estimation for a target of unknown shape: odometry, a map of what was seen, and registration to this map."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.quaternion import from_matrix, rotate, to_matrix
from safe_inspect.plugins.functor import functor_field
from safe_inspect.rendezvous.depth_camera import no_frame
from safe_inspect.rendezvous.estimate import BodyState, JointErrors, StateEstimate, unknown_estimate
from safe_inspect.rendezvous.estimation.corner import nearest_corner
from safe_inspect.rendezvous.estimation.estimators import (
    EstimatorContext,
    PipelineEstimator,
    PipelineEstimatorRun,
    StateEstimator,
)
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline
from safe_inspect.rendezvous.estimation.states import TargetEstimate, largest_sigma
from safe_inspect.rendezvous.estimation.station import Station
from safe_inspect.rendezvous.estimation.surface_map import SurfaceMap
from safe_inspect.rendezvous.front_end.model import ModelFrontEnd, ModelFrontEndRun
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse, move, pose, skew
from safe_inspect.rendezvous.readings import Reading, Readings
from safe_inspect.rendezvous.target.model import Target, TriangleMesh
from safe_inspect.rendezvous.target.solid import MeshSolid, PointSolid
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration, PositiveDuration, PositiveLength

#: Standard deviation of the map's origin from the centre of mass [m].
_CENTRE = 0.03
#: Misfit of the motion above which no map is made of it, in standard deviations; time until the next attempt [s].
_LARGEST_MISFIT, _AGAIN = 3.0, 30.0
#: Number of times that frames are aligned and their motion is fitted again.
_PASSES = 4
#: Standard deviation of the surface's attitude above which no map is made [rad], and the longest time without a pose to
#: the map while frames are registered to it again [s].
_LARGEST_ATTITUDE, _LOST = np.deg2rad(5.0), 4.0
#: Ratio of the noise that is assumed for registration to the map to that of the camera: errors of the poses blur a map.
_BLUR = 1.5
#: Factor of the deviations from the motion that mean that it has changed: a map is distorted and has holes.
_TOLERANCE = 4.0
#: Distance between the chaser at the start and the sphere that contains the target [m].
START_DISTANCE = 0.25
#: Distance of the mating point from the centre before it is marked [m]: the camera looks at the centre.
_UNMARKED = 1e-3


class MappingEstimator(StateEstimator):
    """Estimator for a target of unknown shape that maps it during the observation.

    A front end for unknown shapes and a fit of the motion give the poses of the frames, the alignment of their points
    corrects them, and they give a map. The frames are then registered to the map as to a known model, and from then on
    the estimate comes from registration to this map. The mating point is the one that an operator marks in frames.
    It computes in metres, which suits targets of 0.5 to 2 m.

    Attributes:
        front_end: Computes relative poses from frames before there is a map.
        model_front_end: Registers frames to the map.
        radius: Radius of a sphere about the centre of mass that is known to contain the target [m]. The chaser must
            start 0.25 m outside of it.
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


class _Found(NamedTuple):
    """What a pipeline has found about the target.

    Attributes:
        poses: T_GB of the frames, by their number, shape (4, 4) each.
        centre: Centre of mass in G [m], shape (3,).
        model: T_GM of the map that frames are registered to, shape (4, 4); None without one.
        motion: The motion.
    """

    poses: dict[int, FloatArray]
    centre: FloatArray
    model: FloatArray | None
    motion: TargetEstimate

    @classmethod
    def of(cls, pipeline: EstimationPipeline | None) -> _Found | None:
        """Return what a pipeline has found; None if the motion is not known well enough for a map."""
        if pipeline is None or pipeline.target is None or pipeline.graph is None:
            return None
        motion, graph = pipeline.target, pipeline.graph
        # Axes that are not known, of a nearly spherical inertia for instance, do not move the surface.
        of_surface = largest_sigma(motion.covariance[:3, :3]) ** 2 - motion.axes_sigma**2
        if motion.misfit > _LARGEST_MISFIT or of_surface > _LARGEST_ATTITUDE**2:
            return None
        return cls(pipeline.motion_poses(motion), graph.centre_glued, graph.model, motion)


class _Mapped(NamedTuple):
    """The target that was mapped.

    Attributes:
        target: The target, about the centre of mass as it was known when the map was made.
        origin: That centre of mass in the frame M of the map that frames are registered to [m], shape (3,).
    """

    target: Target
    origin: FloatArray


class _MappingEstimatorRun:
    """Estimator of one mission.

    Args:
        context: Context of the estimator.
        options: The options.
    """

    def __init__(self, context: EstimatorContext, options: MappingEstimator) -> None:
        self._context, self._options = context, options
        correlation = options.correlation
        odometry = PipelineEstimator(front_end=options.front_end, known_target=False, correlation=correlation)
        back_end = ISAM2BackEnd(model_centre=_CENTRE)
        own = options.model_front_end
        blurred = {"range_sigma": _BLUR * own.range_sigma, "range_growth": _BLUR * own.range_growth}
        front_end = own.model_copy(update=blurred)
        self._to_map = PipelineEstimator(front_end=front_end, back_end=back_end, correlation=correlation)
        self._run = PipelineEstimatorRun(context, odometry)
        noise = (float(options.model_front_end.range_sigma), float(options.model_front_end.range_growth))
        self._surface = SurfaceMap(context.camera, context.T_BC, noise)
        self._station: Station | None = None
        self._readings: list[Readings] = []
        self._marks: list[tuple[int, FloatArray]] = []
        #: Times of the next attempt to make a map, and of the end of its computation [s].
        self._due, self._ready = options.duration, np.inf
        self._mapped: _Mapped | None = None
        self._newest: Edge | None = None
        #: T_MM' from where frames show the map to where the estimate has it.
        self._correction = np.eye(4)

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; see `EstimatorRun`."""
        estimate = self._run.update(readings)
        if self._mapped is not None:
            return self._about_origin(estimate, self._mapped)
        # Odometry errs more often than something strikes the target.
        self._run.tolerate(np.inf)
        station = self._keep(readings, estimate.chaser)
        if readings.time >= self._due - 1e-9:
            self._due = readings.time + _AGAIN
            if self._marks and _Found.of(self._run.pipeline) is not None:
                self._due, self._ready = np.inf, readings.time + self._options.computing_time
        if readings.time >= self._ready - 1e-9:
            self._due, self._ready = readings.time + _AGAIN, np.inf
            mapped = self._make_map()
            if mapped is not None:
                return mapped
        return self._not_mapped(estimate, station)

    def _not_mapped(self, estimate: StateEstimate, station: Station) -> StateEstimate:
        """Return an estimate without a motion, by which the chaser keeps its distance from the points that it sees.

        Until the target has turned far enough, the graph's centre of mass may be off by half of the target's size, and
        the chaser's position with it.
        """
        chaser = estimate.chaser._replace(position=station.position, velocity=station.velocity)
        known = self._context.target.principal
        return unknown_estimate(estimate.time, station.seen, chaser, known, estimate.correlation, station.centre)

    def _keep(self, readings: Readings, chaser: BodyState) -> Station:
        """Keep readings for the map, and return the chaser's motion relative to what it sees."""
        if self._station is None:
            assert readings.start is not None, "the first readings contain the chaser's state"
            known = self._context.target.swept_radius + self._context.chaser.radius
            self._station = Station(readings.start, known + START_DISTANCE)
        if readings.command is not None:
            force = rotate(chaser.orientation, readings.command.force)
            self._station.advance(force / self._context.chaser.mass, self._context.step)
        frame = readings.frame
        if frame is None and not self._readings:
            frame = no_frame(readings.time)  # the pipeline counts an empty frame if there is none at the start
        self._readings.append(readings)
        if frame is not None:
            number = self._surface.add(frame)
            if readings.mark is not None:
                self._marks.append((number, readings.mark))
            if len(frame.points):
                middle = move(self._context.T_BC, frame.points.mean(axis=0, keepdims=True))[0]
                self._station.correct(-rotate(chaser.orientation, middle), self._context.frame_period)
                self._station.seen = readings.time
        return self._station

    def _make_map(self) -> StateEstimate | None:
        """Make the map from all frames, and register them to it.

        Returns:
            The estimate from the registration to the map; None if it failed.
        """
        found = _Found.of(self._run.pipeline)
        if found is None:
            return None
        found = self._aligned(found)
        model = self._model_of(found)
        origin = pose(np.eye(3), -found.centre)
        expected = {number: origin @ T_GB for number, T_GB in found.poses.items()}
        run = PipelineEstimatorRun(replace(self._context, target=model), self._to_map, expected)
        estimate = run.replay(self._readings, _LOST)
        found = None if estimate is None else _Found.of(run.pipeline)
        if estimate is None or found is None or found.model is None:
            return None
        T_MG, poses = inverse(found.model), found.poses  # noqa: N806
        marks = [move(T_MG @ poses[number], mark[None])[0] for number, mark in self._marks if number in poses]
        if not marks:
            return None
        origin = move(T_MG, found.centre[None])[0]
        mesh = TriangleMesh(model.mesh.vertices - origin, model.mesh.faces)
        mark = np.median(marks, axis=0) - origin
        solid = self._surface.solid(poses, model.mesh, found.model, origin)
        # The nearest vertex of a map may be in the middle of a face.
        corner = nearest_corner(mesh, mark)
        self._mapped = _Mapped(Target(solid, mesh, model.inertia, model.R_MT.T @ mark, corner=corner), origin)
        self._run = run
        self._run.tolerate(_TOLERANCE)
        self._readings.clear()
        return self._about_origin(estimate, self._mapped)

    def _aligned(self, found: _Found) -> _Found:
        """Return the frames with poses for which their points coincide, and the motion that fits these poses.

        The motion from odometry may err by degrees. Alignment decreases the errors of the attitudes but bends them, and
        the fit of a free body to the aligned attitudes removes what no free body does; they take turns.
        """
        pipeline = self._run.pipeline
        assert pipeline is not None, "a pipeline has found the motion"
        for _ in range(_PASSES):
            poses = pipeline.motion_poses(found.motion)
            poses = self._surface.aligned(poses, found.centre, pipeline.attitudes(found.motion))
            found = found._replace(poses=poses, motion=pipeline.refitted(poses) or found.motion)
        return found

    def _model_of(self, found: _Found) -> Target:
        """Return the map of all frames, about the centre of mass, for the registration of frames."""
        surface = self._surface.mesh(found.poses)
        axes = to_matrix(found.motion.q_GT)
        inertia = axes @ np.diag(found.motion.inertia) @ axes.T
        mesh = TriangleMesh(surface.vertices - found.centre, surface.faces)
        known = self._context.target
        return Target(PointSolid(((mesh.vertices, 0.0),)), mesh, 0.5 * (inertia + inertia.T), known.mating_point)

    def _about_origin(self, estimate: StateEstimate, mapped: _Mapped) -> StateEstimate:
        """Return an estimate of the pose of the map, about the point that was the centre of mass when it was made.

        Frames show this point much more accurately than the centre of mass, about which it rotates. The map is placed
        where the newest frames show it, and moves as the target's estimated motion says.
        """
        pipeline, target, errors, mismatch = self._run.pipeline, estimate.target, estimate.errors, estimate.mismatch
        if pipeline is not None and pipeline.graph is not None and pipeline.graph.model is not None:
            graph, R_MT = pipeline.graph, mapped.target.R_MT  # noqa: N806
            centre = move(inverse(pipeline.graph.model), graph.centre_glued[None])[0]
            offset = R_MT.T @ (centre - mapped.origin)

            def pose_of(orientation: FloatArray) -> FloatArray:
                """Return T_WM, about the origin, at an attitude of the target."""
                R_WT = to_matrix(orientation)  # noqa: N806
                return pose(R_WT @ R_MT.T, target.position - R_WT @ offset)

            seen = [edge for edge in pipeline.measured if edge.first == MODEL]
            front_end = self._run.front_end
            assert isinstance(front_end, ModelFrontEndRun), "frames are registered to the map"
            shown = front_end.placing.pose
            mismatch = front_end.placing.mismatch if np.isfinite(estimate.mismatch) else np.inf
            if seen and shown is not None and seen[-1] is not self._newest:
                (q,), _ = estimate.predict(np.array([estimate.updated]))
                shown = pose(np.eye(3), -mapped.origin) @ shown
                self._correction = inverse(pose_of(q)) @ graph.chaser @ inverse(shown)
            self._newest = seen[-1] if seen else self._newest
            T_WM = pose_of(target.orientation) @ self._correction  # noqa: N806
            target = target._replace(position=T_WM[:3, 3], orientation=from_matrix(T_WM[:3, :3] @ R_MT))
            if isinstance(errors, JointErrors) and self._newest is not None:
                errors = _with_offset(
                    errors, self._newest, mapped.origin, graph.chaser[:3, :3], target.orientation, offset
                )
        return replace(estimate, target=target, errors=errors, mismatch=mismatch, mapped=mapped.target)


def _with_offset(
    errors: JointErrors,
    seen: Edge,
    origin: FloatArray,
    R_WB: FloatArray,  # noqa: N803
    q_WT: FloatArray,  # noqa: N803
    offset: FloatArray,
) -> JointErrors:
    """Return errors whose centre is a point of the map, and whose offset is the error of the centre of mass.

    Args:
        errors: Errors of the estimated centre of mass.
        seen: Pose of the newest frame relative to the map.
        origin: The point in M [m], shape (3,).
        R_WB: Attitude of the chaser, shape (3, 3).
        q_WT: Attitude of the target, shape (4,).
        offset: Estimated position of the centre of mass relative to the point, in T [m], shape (3,).
    """
    by_pose = np.hstack([skew(move(inverse(seen.pose), origin[None])[0]), -np.eye(3)])
    centre = R_WB @ by_pose @ seen.covariance @ by_pose.T @ R_WB.T
    R_TW = to_matrix(q_WT).T  # noqa: N806
    joint, mass = errors.joint.copy(), errors.joint[8:11, 8:11]
    joint[8:11, 8:11] = centre
    spread = R_TW @ mass @ R_TW.T + np.outer(offset, offset)
    return replace(errors, centre=largest_sigma(centre), joint=joint, offset=spread)
