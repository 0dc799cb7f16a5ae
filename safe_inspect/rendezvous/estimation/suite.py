"""The sensors of one mission: from its truth to depth frames and inertial samples."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.rendezvous.estimate import BodyState, EstimatorContext, InertialTruth
from safe_inspect.rendezvous.poses import pose
from safe_inspect.rendezvous.sensors.imu import Imu, ImuNoise, InertialSample
from safe_inspect.rendezvous.sensors.tof import DepthFrame, TimeOfFlightCamera
from safe_inspect.types import FloatArray


class SensorSuite:
    """The depth camera and the inertial unit of one mission.

    Args:
        context: What the estimator is made with.
        camera: The camera.
        noise: Errors of the inertial unit.
        ticks: Ticks of the truth between two samples of the unit.
        render: Whether frames have points; without, they only say whether the target is in view.
    """

    def __init__(
        self, context: EstimatorContext, camera: TimeOfFlightCamera, noise: ImuNoise, ticks: int, *, render: bool
    ) -> None:
        self._context, self._camera, self._ticks = context, camera.geometry, ticks
        self._renderer = camera(context.target) if render else None
        self._imu = Imu(noise, self.period, context.streams)
        self._tick = self._frames = 0
        self.T_BC = pose(R_BC, np.array(context.camera_position))

    @property
    def period(self) -> float:
        """Time between two samples of the inertial unit [s]."""
        return self._ticks * self._context.tick

    def samples(self, inertial: InertialTruth) -> list[InertialSample]:
        """Return the samples of a step; none where the unit is silent."""
        history = inertial.history
        count = history.translation.shape[1]
        measured = []
        for tick in range(count):
            self._tick += 1
            if self._tick % self._ticks:
                continue
            rotation = to_matrix(history.orientation[0, tick])
            acceleration = history.wrench[0, tick, :3] / self._context.mass
            sample = self._imu.sample(rotation, acceleration, history.angular_velocity[0, tick])
            time = (tick + 1) * self._context.tick
            measured.append(
                InertialSample(time, sample.acceleration + inertial.bias[:3], sample.rate + inertial.bias[3:])
            )
        return [] if inertial.silent else measured

    def pose_in_model(self, chaser: BodyState, target: BodyState) -> FloatArray:
        """Return the true T_MB, shape (4, 4)."""
        R_MW = self._context.target.R_MT @ to_matrix(target.orientation).T  # noqa: N806
        return pose(R_MW @ to_matrix(chaser.orientation), R_MW @ (chaser.position - target.position))

    def frame(self, time: float, chaser: BodyState, target: BodyState) -> DepthFrame:
        """Return the next frame."""
        T_MC = self.pose_in_model(chaser, target) @ self.T_BC  # noqa: N806
        number, self._frames = self._frames, self._frames + 1
        if self._renderer is not None:
            return self._renderer.render(T_MC[:3, :3], T_MC[:3, 3], self._context.streams, number, time)
        centre = -T_MC[:3, :3].T @ T_MC[:3, 3]
        half = 0.5 * np.array([self._camera.width, self._camera.height]) / self._camera.focal_length
        in_view = centre[2] > 0.0 and (np.abs(centre[:2]) <= half * centre[2] + self._context.target.swept_radius).all()
        flags = () if in_view else ("out_of_view",)
        return DepthFrame(time, np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((0, 0), bool), flags)
