"""Simulated sensors of relative poses and of states with stated errors, for tests and ablations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import Field

from safe_inspect.config.models import Model
from safe_inspect.dynamics.quaternion import exp, multiply
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors
from safe_inspect.rendezvous.poses import MODEL, Edge, difference, inverse, perturbed
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeAngle, NonNegativeAngularRate, NonNegativeLength

#: Smallest standard deviation of a stated covariance [rad, m].
_LEAST_SIGMA = 1e-6


class PoseSensor(Model):
    """Sensor of the chaser's poses relative to earlier frames and to the known model of the target.

    Standard deviations are those of one axis. The error of the view is constant for all frames of a keyframe and adds
    to their poses, so that it cancels in poses between two frames of the same keyframe.

    Attributes:
        rotation_sigma: Standard deviation of the rotation between two frames [rad].
        translation_sigma: Standard deviation of the translation between two frames [m].
        view_rotation: Standard deviation of the view's rotation [rad].
        view_translation: Standard deviation of the view's translation [m].
        model: Whether poses relative to the known model are measured.
        model_rotation: Standard deviation of the rotation of a pose relative to the model [rad]; the error is constant
            for a keyframe.
        model_translation: Standard deviation of the translation of a pose relative to the model [m]; the error is
            constant for a keyframe.
        keyframe: Rotation of the target as seen from the chaser after which a new keyframe starts [rad].
        skips: Number of earlier frames relative to which poses are measured.
    """

    rotation_sigma: NonNegativeAngle = 0.003490658503988659  # type: ignore[valid-type]
    translation_sigma: NonNegativeLength = 0.003  # type: ignore[valid-type]
    view_rotation: NonNegativeAngle = 0.008726646259971648  # type: ignore[valid-type]
    view_translation: NonNegativeLength = 0.005  # type: ignore[valid-type]
    model: bool = True
    model_rotation: NonNegativeAngle = 0.008726646259971648  # type: ignore[valid-type]
    model_translation: NonNegativeLength = 0.005  # type: ignore[valid-type]
    keyframe: NonNegativeAngle = 0.2094395102393195  # type: ignore[valid-type]
    skips: int = Field(default=3, ge=1)


class MarkSensor(Model):
    """Operator who marks the mating point in the frames that show the surface below it.

    Attributes:
        sigma: Standard deviation of the error along each axis [m].
    """

    sigma: NonNegativeLength = 5e-3  # type: ignore[valid-type]


@dataclass(frozen=True, eq=False)
class PoseFrame(DepthFrame):
    """A frame without points that contains relative poses measured by a simulated sensor instead.

    Attributes:
        number: Number of the frame, to which its poses refer.
        poses: The poses, in the form that a front end returns.
    """

    number: int
    poses: tuple[Edge, ...]

    def in_units_of(self, length: float) -> PoseFrame:
        """Return the frame with all lengths divided by a length [m]."""
        return replace(self, poses=tuple(edge.in_units_of(length) for edge in self.poses))


class PoseSensorRun:
    """The pose sensor of one mission.

    Args:
        sensor: Errors of the sensor.
        streams: The random streams of the mission.
    """

    def __init__(self, sensor: PoseSensor, streams: Streams) -> None:
        self._sensor, self._streams = sensor, streams
        #: Number, true pose, and tangent of the view error of each frame.
        self._frames: list[tuple[int, FloatArray, FloatArray]] = []
        self._keyframe: FloatArray | None = None
        self._drawn = 0

    def measure(self, number: int, pose: FloatArray, *, in_view: bool) -> tuple[Edge, ...]:
        """Return the poses that are measured in a frame.

        Args:
            number: Number of the frame.
            pose: The true T_MB, shape (4, 4).
            in_view: Whether the target is in view; if not, nothing is measured.
        """
        if not in_view:
            return ()
        sensor = self._sensor
        if self._keyframe is None or np.linalg.norm(difference(self._keyframe, pose)[:3]) > sensor.keyframe:
            self._keyframe, self._drawn = pose, self._drawn + 1
        unit = self._streams.normal("front_end.view", 12, self._drawn)[0]
        view = unit[:6] * np.repeat([sensor.view_rotation, sensor.view_translation], 3)
        edges = []
        for place, (first, before, own_view) in enumerate(self._frames[-sensor.skips :]):
            kind: Literal["odometry", "skip"] = "odometry" if first == number - 1 else "skip"
            drawn = self._streams.normal(f"front_end.edge.{place}", 6, number)[0]
            error = drawn * np.repeat([sensor.rotation_sigma, sensor.translation_sigma], 3)
            measured = perturbed(inverse(perturbed(before, own_view)) @ perturbed(pose, view), error)
            own = 0.0 if np.array_equal(view, own_view) else np.sqrt(2.0)
            covariance = _covariance(
                np.hypot(sensor.rotation_sigma, own * sensor.view_rotation),
                np.hypot(sensor.translation_sigma, own * sensor.view_translation),
            )
            edges.append(Edge(first, number, measured, covariance, 1.0, kind))
        if sensor.model:
            error = unit[6:] * np.repeat([sensor.model_rotation, sensor.model_translation], 3)
            covariance = _covariance(sensor.model_rotation, sensor.model_translation)
            edges.append(Edge(MODEL, number, perturbed(pose, error), covariance, 1.0, "model"))
        self._frames.append((number, pose, view))
        return tuple(edges)


def _covariance(rotation: float, translation: float) -> FloatArray:
    sigmas = np.maximum(np.repeat([rotation, translation], 3), _LEAST_SIGMA)
    return np.diag(sigmas**2)


class StateSensor(Model):
    """Sensor that measures the chaser's state exactly, and the target's with Gaussian errors of attitude and rate.

    With e of unit variance and ``e_j+1 = rho e_j + sqrt(1 - rho^2) n``, the measured attitude is
    ``q Exp(sigma e_1..3)`` and the measured rate is ``w + sigma e_4..6``. Without errors it measures the true state.

    Attributes:
        attitude_sigma: Standard deviation of the attitude about each principal axis [rad].
        rate_sigma: Standard deviation of each component of the angular velocity [rad/s].
        correlation: Correlation rho of the errors of two consecutive measurements.
    """

    attitude_sigma: NonNegativeAngle = 0.0  # type: ignore[valid-type]
    rate_sigma: NonNegativeAngularRate = 0.0  # type: ignore[valid-type]
    correlation: float = Field(default=0.9, ge=0.0, lt=1.0)


@dataclass(frozen=True, eq=False)
class StateReading:
    """The states of chaser and target, as measured by a simulated sensor.

    Attributes:
        chaser: State of the chaser.
        target: State of the target; None if it was not measured in this step.
        errors: Errors of the measurement.
        correlation: Correlation of the errors of two consecutive measurements of the target.
    """

    chaser: BodyState
    target: BodyState | None
    errors: EstimateErrors
    correlation: float


class StateSensorRun:
    """The state sensor of one mission.

    Args:
        sensor: Errors of the sensor.
        period: Time between two measurements of the target [s].
        streams: The random streams of the mission.
    """

    def __init__(self, sensor: StateSensor, period: float, streams: Streams) -> None:
        self._errors, self._correlation = EstimateErrors(sensor.attitude_sigma, sensor.rate_sigma), sensor.correlation
        self._period, self._streams = period, streams
        self._unit = streams.normal("estimate.error", 6, 0)[0]
        self._count, self._last = 0, -np.inf

    def measure(self, time: float, chaser: BodyState, target: BodyState, *, silent: bool) -> StateReading:
        """Return the measurement at a time.

        Args:
            time: The time [s].
            chaser: The chaser's true state.
            target: The target's true state.
            silent: Whether the target is not measured now.
        """
        seen = None
        if not silent and time >= self._last + self._period - 1e-9:
            seen = self._target(target)
            self._last = time
        return StateReading(chaser, seen, self._errors, self._correlation)

    def _target(self, target: BodyState) -> BodyState:
        if np.isfinite(self._last):
            self._count += 1
            fresh = self._streams.normal("estimate.error", 6, self._count)[0]
            self._unit = self._correlation * self._unit + np.sqrt(1.0 - self._correlation**2) * fresh
        orientation = multiply(target.orientation, exp(self._errors.attitude * self._unit[:3]))
        rate = target.angular_velocity + self._errors.rate * self._unit[3:]
        return BodyState(target.position, target.velocity, orientation, rate)
