"""Odometry, skip edges and loops for an unknown shape: generalised ICP (small_gicp) to a submap of keyframes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.front_end.base import FrontEnd, FrontEndContext, Registration, RelativeMotion
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import (
    Edge,
    adjoint,
    difference,
    inverse,
    move,
    orthonormal,
    perturbed,
    pose,
    rotation_exp,
    rotation_log,
)
from safe_inspect.types import FloatArray

#: Voxel size for downsampling a cloud [m], and numbers of points from which a surface and its normal are estimated:
#: normals of few points scatter so much that a plane seems to show how it turns about its own normal.
_VOXEL, _NEIGHBOURS, _NORMAL_NEIGHBOURS = 0.012, 12, 40
#: Maximum distances of correspondences in consecutive passes [m].
_REACH = (0.06, 0.03)
#: Standard deviations of the error between two views that does not decrease with the number of points [rad, m].
_VIEW = (np.deg2rad(0.5), 4e-3)
#: Standard deviations about the middle of a cloud of the prediction of its pose, and of a pose without one [rad, m];
#: and that of the height of a point above the surface, where four neighbours count as one because they err alike [m].
_PREDICTION, _UNPREDICTED, _HEIGHT = (np.deg2rad(2.0), 0.02), (np.deg2rad(10.0), 0.05), 0.01
_Kind = Literal["odometry", "skip", "loop", "relocalised"]
#: Frames with fewer points are not used.
_LEAST_POINTS = 150
#: Rotation from the last keyframe at which a new one is added [rad].
_KEYFRAME_ANGLE = 0.20943951023931953
#: Minimum fraction of inliers of an accepted registration, and its maximum difference from the prediction [rad, m].
_LEAST_INLIERS, _LARGEST_TURN, _LARGEST_SHIFT = 0.6, np.deg2rad(10.0), 0.1
#: Number of consecutive failures after which a frame is relocalised with respect to all keyframes.
_FAILURES = 3
#: Maximum predicted angle between the directions of view of a loop [rad], its minimum fraction of inliers, and how many
#: keyframes it must go back.
_LOOP_ANGLE, _LOOP_INLIERS, _LOOP_GAP = np.deg2rad(20.0), 0.75, 8
#: Factor of the covariances, calibrated on simulation.
_SCALE = 10.0


@dataclass(frozen=True, eq=False)
class _PreparedCloud:
    """Downsampled points with the covariances of their surfaces and a search tree.

    Attributes:
        points: Positions [m], shape (n, 3).
        cloud: The cloud of small_gicp.
        tree: The search tree of the cloud.
    """

    points: FloatArray
    cloud: Any
    tree: Any

    def __len__(self) -> int:
        return len(self.points)


def prepared_cloud(points: FloatArray) -> _PreparedCloud:
    """Prepare points [m], shape (n, 3), for registration."""
    library = require("small_gicp")
    cloud, tree = library.preprocess_points(
        np.ascontiguousarray(points, np.float64), _VOXEL, _NEIGHBOURS, num_threads=1
    )
    library.estimate_normals(cloud, tree, num_neighbors=_NORMAL_NEIGHBOURS, num_threads=1)
    return _PreparedCloud(np.asarray(cloud.points())[:, :3], cloud, tree)


def _about_middle(cloud: _PreparedCloud, sigmas: tuple[float, float]) -> FloatArray:
    """Return the covariance of a tangent that turns and moves a cloud about its middle [rad, m], shape (6, 6)."""
    middle = cloud.points.mean(axis=0) if len(cloud) else np.zeros(3)
    carry = adjoint(pose(np.eye(3), middle))
    return np.asarray(carry @ np.diag(np.repeat(sigmas, 3) ** 2) @ carry.T)


def register(
    target: _PreparedCloud, source: _PreparedCloud, start: FloatArray, *, is_predicted: bool = False
) -> Registration:
    """Return the pose that maps `source` to `target`, first with distant correspondences, then with close ones.

    The score is the root mean square of the residuals, each divided by the width of the surface that it is measured
    from. The inliers are the fraction of the source's points that have a correspondence.

    Args:
        target: The fixed cloud.
        source: The moving cloud.
        start: Initial pose, shape (4, 4).
        is_predicted: Whether the initial pose holds in the directions that the surface does not show, such as the turn
            of a plane about its normal.
    """
    library = require("small_gicp")
    placed = start
    result: Any = None
    for reach in _REACH:
        result = library.align(
            target.cloud,
            source.cloud,
            target.tree,
            init_T_target_source=placed,
            registration_type="GICP",
            max_correspondence_distance=reach,
            num_threads=1,
            max_iterations=30,
            rotation_epsilon=1e-4,
            translation_epsilon=1e-5,
        )
        placed = orthonormal(np.asarray(result.T_target_source))
    found = max(int(result.num_inliers), 1)
    error = max(2.0 * float(result.error) / found, 1e-9)
    normals = np.asarray(source.cloud.normals())[:, :3]
    heights = np.hstack([np.cross(source.points, normals), normals])  # derivatives by the tangent from the right
    prior = np.linalg.inv(_about_middle(source, _PREDICTION if is_predicted else _UNPREDICTED))
    unshown = np.linalg.inv(heights.T @ heights / _HEIGHT**2 + prior)
    if is_predicted:
        placed = perturbed(placed, unshown @ prior @ difference(placed, start))
    # Two views sample different points: their common error rotates the cloud about its mean.
    systematic = _about_middle(source, _VIEW) + unshown
    inliers = found / max(len(source), 1)
    return Registration(placed, np.asarray(result.H), float(np.sqrt(error)), inliers, error, systematic)


@dataclass(frozen=True, eq=False)
class _Keyframe:
    """Frame that others are registered to.

    Attributes:
        number: Number of the frame.
        pose: T_GB as estimated by this front end, shape (4, 4).
        cloud: Points in B [m].
    """

    number: int
    pose: FloatArray
    cloud: _PreparedCloud


class GicpSubmapFrontEnd(FrontEnd):
    """Front end that registers each frame to a submap of keyframes with generalised ICP, for an unknown shape.

    A new keyframe is also registered to the previous ones and, if the same view was seen before, to keyframes of that
    view. After several failures, a frame is relocalised with respect to all keyframes.

    Attributes:
        submap: Number of the newest keyframes to which frames are registered.
        skips: Number of keyframes before the last one to which a new keyframe is registered.
        loops: Whether to register keyframes to earlier ones with a similar view.
    """

    submap: int = Field(default=100, ge=1)
    skips: int = Field(default=2, ge=0)
    loops: bool = True

    def __call__(self, context: FrontEndContext) -> _SubmapFrontEndRun:
        """Return the front end for a mission."""
        return _SubmapFrontEndRun(self, context)


class _SubmapFrontEndRun:
    """Front end of one mission; it registers each frame to earlier keyframes, in the frame G of the first one.

    Args:
        options: The options.
        context: Information that is available before the first frame.
    """

    def __init__(self, options: GicpSubmapFrontEnd, context: FrontEndContext) -> None:
        self._cleaning = Cleaning(context.camera)
        self._T_BC, self._options, self._streams = context.T_BC, options, context.streams
        self._axis = context.T_BC[:3, 2]  # the camera's optical axis in B
        self.keyframes: list[_Keyframe] = []
        # Both are set when the first keyframe is added.
        self._submap: _PreparedCloud
        self._motion: RelativeMotion
        self._count = self._failures = 0

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the edge of a frame to the last keyframe and, for a new keyframe, its edges to earlier ones."""
        number = self._count
        self._count += 1
        if self.keyframes:
            self._motion.turned(rotation)
        points = self._cleaning(frame, self._T_BC).points
        if len(points) < _LEAST_POINTS:
            self._failures += 1
            return []
        cloud = prepared_cloud(points)
        if not self.keyframes:
            self._add(number, np.eye(4), cloud)
            self._motion = RelativeMotion(frame.time, np.eye(4))
            return []
        found, kind = self._locate(cloud, predicted, frame.time)
        if found is None:
            self._failures += 1
            return []
        self._failures = 0
        if kind == "relocalised":
            self._motion.place(frame.time, found.pose)
        else:
            self._motion.observe(frame.time, found.pose)
        last = self.keyframes[-1]
        edges = [_edge(last, number, inverse(last.pose) @ found.pose, found, kind)]
        turn = rotation_log(last.pose[:3, :3].T @ found.pose[:3, :3])
        if np.linalg.norm(turn) >= _KEYFRAME_ANGLE or found.inliers < 0.5:
            edges += self._skips(number, found.pose, cloud)
            if self._options.loops:
                edges += self._loops(number, found.pose, cloud)
            self._add(number, found.pose, cloud)
        return edges

    def _locate(
        self, cloud: _PreparedCloud, predicted: FloatArray | None, time: float
    ) -> tuple[Registration | None, _Kind]:
        """Return T_GB of a cloud from its prediction or, after failures, from the keyframes; None if neither fits."""
        start = self._motion.predict(time)
        if self._failures and predicted is not None:
            start = predicted
        found = register(self._submap, cloud, start, is_predicted=self._motion.is_known)
        if self._accepts(start, found):
            return found, "odometry"
        if self._failures < _FAILURES:
            return None, "odometry"
        return self._relocalise(cloud), "relocalised"

    def _relocalise(self, cloud: _PreparedCloud) -> Registration | None:
        """Return T_GB of a cloud from registration to each keyframe, starting with equal means, or None.

        The submap must confirm the pose.
        """
        fits = []
        for one in self.keyframes:
            middles = one.cloud.points.mean(axis=0) - cloud.points.mean(axis=0)
            found = register(one.cloud, cloud, pose(np.eye(3), middles))
            fits.append((found.inliers, one.pose @ found.pose))
        for _, start in sorted(fits, key=lambda fit: -fit[0])[:3]:
            found = register(self._submap, cloud, start)
            if self._accepts(start, found) and found.inliers >= _LOOP_INLIERS:
                return found
        return None

    def _accepts(self, start: FloatArray, found: Registration) -> bool:
        off = difference(start, found.pose)
        middle = self.keyframes[-1].cloud.points.mean(axis=0, keepdims=True)
        shift = np.linalg.norm(move(found.pose, middle) - move(start, middle))
        return bool(
            found.inliers >= _LEAST_INLIERS and np.linalg.norm(off[:3]) <= _LARGEST_TURN and shift <= _LARGEST_SHIFT
        )

    def _skips(self, number: int, T_GB: FloatArray, cloud: _PreparedCloud) -> list[Edge]:  # noqa: N803
        """Return the edges to the keyframes before the last one."""
        edges = []
        for one in self.keyframes[-1 - self._options.skips : -1]:
            start = inverse(one.pose) @ T_GB
            found = register(one.cloud, cloud, start, is_predicted=True)
            if self._accepts(start, found):
                edges.append(_edge(one, number, found.pose, found, "skip"))
        return edges

    def _loops(self, number: int, T_GB: FloatArray, cloud: _PreparedCloud) -> list[Edge]:  # noqa: N803
        """Return the edges to the closest earlier view and to a random close one, from seven starts each."""
        earlier = self.keyframes[: max(len(self.keyframes) - _LOOP_GAP, 0)]
        axes = np.array([one.pose[:3, :3] @ self._axis for one in earlier]).reshape(-1, 3)
        angles = np.arccos(np.clip(axes @ (T_GB[:3, :3] @ self._axis), -1.0, 1.0))  # how it is rolled does not matter
        near = [earlier[k] for k in np.argsort(angles, kind="stable") if angles[k] < _LOOP_ANGLE]
        if not near:
            return []
        drawn = float(self._streams.uniform("front_end.loop", 1, number)[0, 0])
        edges = []
        for one in {one.number: one for one in (near[0], near[int(drawn * len(near))])}.values():
            start = inverse(one.pose) @ T_GB
            found = max(
                (register(one.cloud, cloud, turned) for turned in _starts(start, cloud.points.mean(axis=0))),
                key=lambda candidate: (round(candidate.inliers, 3), -candidate.score),
            )
            turn = np.linalg.norm(rotation_log(start[:3, :3].T @ found.pose[:3, :3]))
            if found.inliers >= _LOOP_INLIERS and turn <= _LARGEST_TURN:
                edges.append(_edge(one, number, found.pose, found, "loop"))
        return edges

    def _add(self, number: int, T_GB: FloatArray, cloud: _PreparedCloud) -> None:  # noqa: N803
        """Add a keyframe and update the submap."""
        self.keyframes.append(_Keyframe(number, T_GB, cloud))
        newest = self.keyframes[-self._options.submap :]
        self._submap = prepared_cloud(np.concatenate([move(one.pose, one.cloud.points) for one in newest]))


def _edge(one: _Keyframe, number: int, between: FloatArray, found: Registration, kind: _Kind) -> Edge:
    """Return the edge from a keyframe to a frame that was registered to it or to the submap."""
    return Edge(one.number, number, between, found.covariance(_SCALE), found.inliers, kind)


def _starts(start: FloatArray, centre: FloatArray) -> list[FloatArray]:
    """Return a start, and the start rotated by +-10 degrees about each axis of B through the body's centre."""
    turns = [np.zeros(3)] + [side * np.deg2rad(10.0) * axis for axis in np.eye(3) for side in (-1.0, 1.0)]
    rotations = [rotation_exp(turn) for turn in turns]
    return [start @ pose(rotation, centre - rotation @ centre) for rotation in rotations]
