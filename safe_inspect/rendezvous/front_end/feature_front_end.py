"""Odometry from matched features: the way of the paper, beside the registration of clouds."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.edges import Edge
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.feature_matching import FeatureFit, FeatureMatching
from safe_inspect.rendezvous.front_end.features import FeatureCloud
from safe_inspect.rendezvous.poses import skew
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class _Described:
    """A frame that others are matched with: its number and its features, in B."""

    number: int
    cloud: FeatureCloud


class FeatureFrontEndRun:
    """Matches each frame with the last one that gave a pose, and with one earlier frame at random (a loop).

    Args:
        cleaning: Cleans frames.
        matching: Matches clouds.
        T_BC: Pose of the camera in B, shape (4, 4).
        scale: Factor of the covariances, calibrated on simulation.
        streams: The random streams of the mission.
        kept: How many frames loops may reach back.
    """

    def __init__(
        self,
        cleaning: Cleaning,
        matching: FeatureMatching,
        T_BC: FloatArray,  # noqa: N803
        scale: float,
        streams: Streams,
        kept: int = 200,
    ) -> None:
        self._cleaning, self._matching, self._T_BC = cleaning, matching, T_BC
        self._scale, self._streams = scale, streams
        self._frames: deque[_Described] = deque(maxlen=kept)
        self._count = 0

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the edges of a frame; neither the prediction nor the gyro is used."""
        number = self._count
        self._count += 1
        points = self._cleaning(frame, self._T_BC).points
        if len(points) < 50:
            return []
        now = _Described(number, self._matching.describe(points, self._T_BC[:3, 3]))
        edges = []
        if self._frames:
            last = self._frames[-1]
            fit = self._matching(last.cloud, now.cloud)
            if fit is not None:
                edges.append(self._edge(last, now, fit))
            drawn = int(float(self._streams.uniform("front_end.loop", 1, number)[0, 0]) * len(self._frames))
            other = self._frames[drawn]
            fit = self._matching(other.cloud, now.cloud) if other is not last else None
            if fit is not None and fit.inliers >= 2 * self._matching.least_inliers:
                edges.append(self._edge(other, now, fit))
        self._frames.append(now)
        return edges

    def _edge(self, first: _Described, second: _Described, fit: FeatureFit) -> Edge:
        """Return the edge with the covariance of points of one common error at the fitted pairs' distances."""
        kind: Literal["odometry", "loop"] = "odometry" if first is self._frames[-1] else "loop"
        points = second.cloud.points
        centre = points.mean(axis=0)
        spread = np.cov((points - centre).T)
        # Information of n points of error sigma: rotation about their middle, then translation of it.
        turn = fit.inliers * (np.trace(spread) * np.eye(3) - spread)
        jacobian = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(centre), np.eye(3)]])
        own = np.block([[turn, np.zeros((3, 3))], [np.zeros((3, 3)), fit.inliers * np.eye(3)]])
        variance = self._scale * self._matching.tolerance**2
        covariance = np.linalg.inv(jacobian.T @ own @ jacobian / variance + np.eye(6))
        share = fit.inliers / max(fit.matches, 1)
        return Edge(first.number, second.number, fit.pose, 0.5 * (covariance + covariance.T), share, kind)
