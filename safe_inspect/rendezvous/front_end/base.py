"""Front ends: the plugin kind, measured poses as one of it, and the registrations and predictions that others share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, Protocol

import numpy as np

from safe_inspect.errors import ConfigError
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthCamera, DepthFrame
from safe_inspect.rendezvous.measured_poses import PoseFrame
from safe_inspect.rendezvous.poses import MODEL, Edge, adjoint, inverse, pose, rotation_exp, rotation_log
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: Weight of the newest difference in the smoothed rate and velocity.
_WEIGHT = 0.5


@dataclass(frozen=True, eq=False)
class Registration:
    """Registration of a frame to another frame, a submap or a model.

    Attributes:
        pose: The pose, shape (4, 4).
        hessian: Information matrix of its tangent from the right, from the measurement alone, shape (6, 6).
        score: Misfit of the points, larger is worse; its definition depends on the method.
        inliers: Fraction of the points that are close to the other surface.
        excess: Positive factor of the inverse Hessian, from the residuals: how much larger the errors are than assumed.
        systematic: Covariance of errors that do not decrease with more points, shape (6, 6); None for none.
    """

    pose: FloatArray
    hessian: FloatArray
    score: float
    inliers: float
    excess: float
    systematic: FloatArray | None = None

    def covariance(self, scale: float = 1.0) -> FloatArray:
        """Return ``scale * excess * H^-1`` plus the systematic covariance, shape (6, 6).

        Without the systematic part, the standard deviation is at most about 1 rad and 1 m in any direction.
        """
        covariance = np.asarray(np.linalg.inv(self.hessian / (scale * self.excess) + np.eye(6)), dtype=np.float64)
        return 0.5 * (covariance + covariance.T) + (0.0 if self.systematic is None else self.systematic)


def relative(first: Registration, second: Registration) -> tuple[FloatArray, FloatArray]:
    """Return the pose ``T1^-1 T2`` between two registrations to the same object, and its covariance, shape (6, 6)."""
    between = inverse(first.pose) @ second.pose
    transport = adjoint(inverse(between))
    covariance = transport @ first.covariance() @ transport.T + second.covariance()
    return between, 0.5 * (covariance + covariance.T)


class RelativeMotion:
    """Predictor of T_MB of a body with constant rate and velocity, relative to a chaser whose rotation is measured.

    With g = R_B'B of the gyro, ``R_MB = D^T R_MB' g``, where D = Exp(w dt) rotates the body about its axes. The origin
    of M, relative to the chaser, moves by ``c = g^T (c' + v dt)``.

    Args:
        time: Time of the first pose [s].
        first: The first pose T_MB, shape (4, 4).

    Attributes:
        time: Time of the newest pose [s].
    """

    def __init__(self, time: float, first: FloatArray) -> None:
        self.time, self._pose = time, first
        self._turn = np.eye(3)
        self._rate: FloatArray | None = None
        self._velocity = np.zeros(3)

    @property
    def is_known(self) -> bool:
        """Whether two poses have been given; until then, the body is predicted to be at rest."""
        return self._rate is not None

    def turned(self, rotation: FloatArray) -> None:
        """Add a rotation of the chaser, R_B'B from the gyro, shape (3, 3)."""
        self._turn = self._turn @ rotation

    def predict(self, time: float) -> FloatArray:
        """Return T_MB at a time [s], shape (4, 4)."""
        seconds = time - self.time
        body = np.eye(3) if self._rate is None else rotation_exp(self._rate * seconds)
        R_MB = body.T @ self._pose[:3, :3] @ self._turn  # noqa: N806
        centre = -self._pose[:3, :3].T @ self._pose[:3, 3]
        return pose(R_MB, -R_MB @ (self._turn.T @ (centre + self._velocity * seconds)))

    def observe(self, time: float, found: FloatArray) -> None:
        """Add a pose T_MB, shape (4, 4), that was measured at a time [s]."""
        if time > self.time:
            seconds = time - self.time
            body = self._pose[:3, :3] @ self._turn @ found[:3, :3].T
            rate = rotation_log(body) / seconds
            self._rate = rate if self._rate is None else (1.0 - _WEIGHT) * self._rate + _WEIGHT * rate
            before, after = -self._pose[:3, :3].T @ self._pose[:3, 3], -found[:3, :3].T @ found[:3, 3]
            velocity = (self._turn @ after - before) / seconds
            self._velocity = self._turn.T @ ((1.0 - _WEIGHT) * self._velocity + _WEIGHT * velocity)
        self.place(time, found)

    def place(self, time: float, found: FloatArray) -> None:
        """Replace the pose T_MB at a time [s], shape (4, 4), and keep rate and velocity."""
        self.time, self._pose, self._turn = time, found, np.eye(3)


@dataclass(frozen=True, eq=False)
class FrontEndContext:
    """Information that is available before the first frame.

    Attributes:
        camera: Geometry of the depth camera.
        T_BC: Pose of the camera in the chaser's frame B, homogeneous matrix, shape (4, 4).
        target: The target, None if its shape is not known.
        streams: Random streams that only the estimator uses.
        poses: T_MB of the first frames as known from elsewhere, by their number, shape (4, 4) each. With them, the
            target is a map, of which parts may be missing.
    """

    camera: DepthCamera
    T_BC: FloatArray
    target: Target | None
    streams: Streams
    poses: Mapping[int, FloatArray] = field(default_factory=dict)


class FrontEndRun(Protocol):
    """Front end of one mission. Frames are numbered by the calls of `step`: 0, 1, 2, ..."""

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the relative poses found in a frame; the list may be empty, and the frame still counts.

        Args:
            frame: The frame.
            predicted: T_GB of this frame predicted by the back end, shape (4, 4); None without a prediction.
            rotation: R_B'B from the gyro, from B now to B' at the previous call, shape (3, 3).
        """


class FrontEnd(Plugin):
    """Base class of front ends, which compute relative poses of the target from depth frames.

    Attributes:
        reads: ``frames`` of a depth camera, or ``poses`` that a simulated sensor measures instead.
    """

    kind: ClassVar[str] = "front_end"
    reads: ClassVar[Literal["frames", "poses"]] = "frames"

    @abstractmethod
    def __call__(self, context: FrontEndContext) -> FrontEndRun:
        """Return the front end for a mission."""


class MeasuredPoses(FrontEnd):
    """Front end that returns the poses measured by ``sensors.poses``; for tests and ablations in a simulation."""

    reads: ClassVar[Literal["frames", "poses"]] = "poses"

    def __call__(self, context: FrontEndContext) -> _MeasuredPosesRun:
        """Return the front end for a mission."""
        return _MeasuredPosesRun()


class _MeasuredPosesRun:
    """Front end of one mission; it numbers the frames by its calls and not by the numbers of the sensor."""

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {MODEL: MODEL}
        self._count = 0

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the poses of a frame.

        Raises:
            ConfigError: The frame is from a camera.
        """
        number, self._count = self._count, self._count + 1
        if not isinstance(frame, PoseFrame):
            if not frame.depth.size:
                return []
            raise ConfigError("MeasuredPoses works in simulations only; choose another front end for depth frames")
        self._numbers[frame.number] = number
        return [replace(edge, first=self._numbers[edge.first], second=number) for edge in frame.poses]
