"""Odometry, skip edges and loops of an unknown shape: registration of clouds to a submap of keyframes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.edges import Edge
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.feature_matching import FeatureMatching
from safe_inspect.rendezvous.front_end.features import FeatureCloud
from safe_inspect.rendezvous.front_end.gicp import GicpRegistration, PreparedCloud
from safe_inspect.rendezvous.front_end.motion import RelativeMotion
from safe_inspect.rendezvous.front_end.registration import Registration
from safe_inspect.rendezvous.poses import difference, inverse, move, pose, rotation_exp, rotation_log
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.types import FloatArray

_Kind = Literal["odometry", "skip", "loop", "relocalised"]


@dataclass(frozen=True)
class SubmapOdometry:
    """Gates and rates of the odometry.

    Attributes:
        least_points: Frames with fewer points are not used.
        keyframe_angle: Turn from the last keyframe that makes a new one [rad].
        submap: Number of the newest keyframes that frames are registered to.
        skips: To how many keyframes before the last one a new keyframe is registered too.
        least_inliers: Least share of inliers of an accepted registration.
        largest_turn: Largest difference from the prediction [rad].
        largest_shift: The same of the position [m].
        failures: Failures in a row after which the frame is looked for among the keyframes.
        loops: Whether keyframes are registered to earlier ones of about the same view.
        loop_angle: Largest predicted angle of a loop [rad].
        loop_inliers: Least share of inliers of a loop.
        loop_gap: How many keyframes a loop must reach back at least.
        scale: Factor of the covariances, calibrated on simulation.
    """

    least_points: int = 150
    keyframe_angle: float = np.deg2rad(12.0)
    submap: int = 100
    skips: int = 2
    least_inliers: float = 0.6
    largest_turn: float = np.deg2rad(10.0)
    largest_shift: float = 0.1
    failures: int = 3
    loops: bool = True
    loop_angle: float = np.deg2rad(20.0)
    loop_inliers: float = 0.75
    loop_gap: int = 8
    scale: float = 10.0


@dataclass(frozen=True, eq=False)
class _Keyframe:
    """A frame that others are registered to: its number, T_GB as estimated here, and its cloud in B."""

    number: int
    pose: FloatArray
    cloud: PreparedCloud


class SubmapFrontEndRun:
    """Registers each frame to the keyframes before it, in the frame G of the first one.

    Args:
        cleaning: Cleans frames.
        registration: Registers clouds.
        matching: Finds a frame among the keyframes without a prediction.
        T_BC: Pose of the camera in B, shape (4, 4).
        odometry: Gates and rates.
        streams: The random streams of the mission.
    """

    def __init__(
        self,
        cleaning: Cleaning,
        registration: GicpRegistration,
        matching: FeatureMatching,
        T_BC: FloatArray,  # noqa: N803
        odometry: SubmapOdometry,
        streams: Streams,
    ) -> None:
        self._cleaning, self._registration, self._matching = cleaning, registration, matching
        self._T_BC, self._odometry, self._streams = T_BC, odometry, streams
        self._keyframes: list[_Keyframe] = []
        self._described: dict[int, FeatureCloud] = {}
        # Both begin with the first keyframe.
        self._submap: PreparedCloud
        self._motion: RelativeMotion
        self._count = self._failures = 0

    @property
    def keyframes(self) -> list[tuple[int, FloatArray, FloatArray]]:
        """Number, T_GB as estimated here, shape (4, 4), and points in B [m], shape (n, 3), of each keyframe."""
        return [(one.number, one.pose, one.cloud.points) for one in self._keyframes]

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the edges of a frame to the last keyframe, and those of a new keyframe to earlier ones."""
        number, odometry = self._count, self._odometry
        self._count += 1
        if self._keyframes:
            self._motion.turned(rotation)
        points = self._cleaning(frame, self._T_BC).points
        if len(points) < odometry.least_points:
            self._failures += 1
            return []
        cloud = self._registration.prepare(points)
        if not self._keyframes:
            self._add(number, np.eye(4), cloud)
            self._motion = RelativeMotion(frame.time, np.eye(4))
            return []
        found, kind = self._locate(cloud, predicted, frame.time)
        if found is None:
            self._failures += 1
            return []
        self._failures = 0
        self._motion.observe(frame.time, found.pose)
        last = self._keyframes[-1]
        edges = [self._edge(last, number, found, kind)]
        turn = rotation_log(last.pose[:3, :3].T @ found.pose[:3, :3])
        if np.linalg.norm(turn) >= odometry.keyframe_angle or found.inliers < 0.5:
            edges += self._skips(number, found.pose, cloud)
            if odometry.loops:
                edges += self._loops(number, found.pose, cloud)
            self._add(number, found.pose, cloud)
        return edges

    def _locate(
        self, cloud: PreparedCloud, predicted: FloatArray | None, time: float
    ) -> tuple[Registration | None, _Kind]:
        """Return T_GB of a cloud by its prediction or, after failures, by features; None when neither fits."""
        start = self._motion.predict(time)
        if self._failures and predicted is not None:
            start = predicted
        found = self._registration(self._submap, cloud, start)
        if self._accepts(start, found):
            return found, "odometry"
        if self._failures < self._odometry.failures:
            return None, "odometry"
        return self._relocalise(cloud), "relocalised"

    def _relocalise(self, cloud: PreparedCloud) -> Registration | None:
        """Return T_GB of a cloud by features of the keyframes, confirmed by registration to the submap."""
        camera = self._T_BC[:3, 3]
        described = self._matching.describe(cloud.points, camera)
        fits = []
        for one in self._keyframes:
            if one.number not in self._described:
                self._described[one.number] = self._matching.describe(one.cloud.points, camera)
            fit = self._matching(self._described[one.number], described)
            if fit is not None:
                fits.append((fit.inliers, one.pose @ fit.pose))
        for _, start in sorted(fits, key=lambda fit: -fit[0])[:3]:
            found = self._registration(self._submap, cloud, start)
            if self._accepts(start, found) and found.inliers >= self._odometry.loop_inliers:
                return found
        return None

    def _accepts(self, start: FloatArray, found: Registration) -> bool:
        off = difference(start, found.pose)
        centre = np.linalg.norm(move(found.pose, self._middle) - move(start, self._middle))
        return bool(
            found.inliers >= self._odometry.least_inliers
            and np.linalg.norm(off[:3]) <= self._odometry.largest_turn
            and centre <= self._odometry.largest_shift
        )

    @property
    def _middle(self) -> FloatArray:
        """The middle of the last keyframe's points in B [m], shape (1, 3)."""
        return np.asarray(self._keyframes[-1].cloud.points.mean(axis=0, keepdims=True))

    def _skips(self, number: int, T_GB: FloatArray, cloud: PreparedCloud) -> list[Edge]:  # noqa: N803
        """Return the edges to the keyframes before the last one."""
        edges = []
        for one in self._keyframes[-1 - self._odometry.skips : -1]:
            found = self._registration(one.cloud, cloud, inverse(one.pose) @ T_GB)
            if found.inliers >= self._odometry.least_inliers:
                edges.append(self._direct(one, number, found, "skip"))
        return edges

    def _loops(self, number: int, T_GB: FloatArray, cloud: PreparedCloud) -> list[Edge]:  # noqa: N803
        """Return the edges to the nearest earlier view and to one at random, from seven starts each."""
        odometry = self._odometry
        earlier = self._keyframes[: max(len(self._keyframes) - odometry.loop_gap, 0)]
        angles = [float(np.linalg.norm(rotation_log(one.pose[:3, :3].T @ T_GB[:3, :3]))) for one in earlier]
        near = [one for _, one in sorted(zip(angles, earlier, strict=True), key=lambda pair: pair[0])]
        near = near[: sum(angle < odometry.loop_angle for angle in angles)]
        if not near:
            return []
        drawn = float(self._streams.uniform("front_end.loop", 1, number)[0, 0])
        edges = []
        for one in {one.number: one for one in (near[0], near[int(drawn * len(near))])}.values():
            start = inverse(one.pose) @ T_GB
            found = max(
                (self._registration(one.cloud, cloud, turned) for turned in _starts(start, cloud.points.mean(axis=0))),
                key=lambda candidate: (round(candidate.inliers, 3), -candidate.score),
            )
            turn = np.linalg.norm(rotation_log(start[:3, :3].T @ found.pose[:3, :3]))
            if found.inliers >= odometry.loop_inliers and turn <= odometry.largest_turn:
                edges.append(self._direct(one, number, found, "loop"))
        return edges

    def _add(self, number: int, T_GB: FloatArray, cloud: PreparedCloud) -> None:  # noqa: N803
        """Add a keyframe and renew the submap."""
        self._keyframes.append(_Keyframe(number, T_GB, cloud))
        newest = self._keyframes[-self._odometry.submap :]
        self._submap = self._registration.prepare(np.concatenate([move(one.pose, one.cloud.points) for one in newest]))

    def _edge(self, last: _Keyframe, number: int, found: Registration, kind: _Kind) -> Edge:
        """Return the edge from a keyframe to a frame that was registered to the submap."""
        between = inverse(last.pose) @ found.pose
        return Edge(last.number, number, between, found.covariance(self._odometry.scale), found.inliers, kind)

    def _direct(self, one: _Keyframe, number: int, found: Registration, kind: _Kind) -> Edge:
        """Return the edge of a frame that was registered to one keyframe."""
        return Edge(one.number, number, found.pose, found.covariance(self._odometry.scale), found.inliers, kind)


def _starts(start: FloatArray, centre: FloatArray) -> list[FloatArray]:
    """Return a start, and it turned by 10 degrees to both sides about each axis of B through the body's middle."""
    turns = [np.zeros(3)] + [side * np.deg2rad(10.0) * axis for axis in np.eye(3) for side in (-1.0, 1.0)]
    rotations = [rotation_exp(turn) for turn in turns]
    return [start @ pose(rotation, centre - rotation @ centre) for rotation in rotations]
