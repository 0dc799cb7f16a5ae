"""Odometry, skip edges and loops for an unknown shape: generalised ICP (small_gicp) to a submap of keyframes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.front_end.base import FrontEnd, FrontEndContext, Registration, RelativeMotion
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.gicp import PreparedCloud, prepared_cloud, register
from safe_inspect.rendezvous.poses import (
    Edge,
    difference,
    inverse,
    move,
    pose,
    rotation_exp,
    rotation_log,
)
from safe_inspect.types import FloatArray

_Kind = Literal["odometry", "skip", "loop", "relocalised"]
#: Frames with fewer points are not used.
_LEAST_POINTS = 150
#: Rotation from the last keyframe at which a new one is added [rad].
_KEYFRAME_ANGLE = 0.20943951023931953
#: Minimum fraction of inliers of an accepted registration, and its maximum difference from the prediction [rad, m].
_LEAST_INLIERS, _LARGEST_TURN, _LARGEST_SHIFT = 0.6, np.deg2rad(10.0), 0.1
#: The same where the prediction is confirmed: a part of the target that comes into view has no keyframe yet.
_LEAST_CONFIRMED, _CONFIRMED_TURN, _CONFIRMED_SHIFT = 0.3, np.deg2rad(3.0), 0.03
#: Number of consecutive failures after which a frame is relocalised with respect to all keyframes.
_FAILURES = 3
#: Maximum predicted angle between the directions of view of a loop [rad], its minimum fraction of inliers, and how many
#: keyframes it must go back.
_LOOP_ANGLE, _LOOP_INLIERS, _LOOP_GAP = np.deg2rad(20.0), 0.75, 8
#: Factor of the covariances, calibrated on simulation.
_SCALE = 10.0


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
    cloud: PreparedCloud


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
        self._submap: PreparedCloud
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
        self, cloud: PreparedCloud, predicted: FloatArray | None, time: float
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

    def _relocalise(self, cloud: PreparedCloud) -> Registration | None:
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
        turn = float(np.linalg.norm(difference(start, found.pose)[:3]))
        middle = self.keyframes[-1].cloud.points.mean(axis=0, keepdims=True)
        shift = float(np.linalg.norm(move(found.pose, middle) - move(start, middle)))
        is_confirmed = turn <= _CONFIRMED_TURN and shift <= _CONFIRMED_SHIFT
        least = _LEAST_CONFIRMED if is_confirmed else _LEAST_INLIERS
        return found.inliers >= least and turn <= _LARGEST_TURN and shift <= _LARGEST_SHIFT

    def _skips(self, number: int, T_GB: FloatArray, cloud: PreparedCloud) -> list[Edge]:  # noqa: N803
        """Return the edges to the keyframes before the last one."""
        edges = []
        for one in self.keyframes[-1 - self._options.skips : -1]:
            start = inverse(one.pose) @ T_GB
            found = register(one.cloud, cloud, start, is_predicted=True)
            if self._accepts(start, found):
                edges.append(_edge(one, number, found.pose, found, "skip"))
        return edges

    def _loops(self, number: int, T_GB: FloatArray, cloud: PreparedCloud) -> list[Edge]:  # noqa: N803
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

    def _add(self, number: int, T_GB: FloatArray, cloud: PreparedCloud) -> None:  # noqa: N803
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
