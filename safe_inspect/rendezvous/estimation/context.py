"""Context that an estimator is created with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.models import ChaserConfig, MissionConfig, SensorsConfig
from safe_inspect.rendezvous.sensing import camera_mount
from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.rendezvous.sensors.tof import DepthCamera
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class EstimatorContext:
    """Properties of chaser, target and sensors that are known before a mission.

    Attributes:
        target: The target.
        chaser: The chaser: its mass, inertia, and documented errors of its actuators.
        step: Control period, at which an estimator is called [s].
        camera: Geometry of the depth camera.
        T_BC: Pose of the camera in B, shape (4, 4).
        frame_period: Time between two frames [s].
        imu: Errors of the inertial unit.
        imu_period: Time between two of its samples [s].
        streams: Random streams that only the estimator uses.
    """

    target: Target
    chaser: ChaserConfig
    step: float
    camera: DepthCamera
    T_BC: FloatArray
    frame_period: float
    imu: ImuNoise
    imu_period: float
    streams: Streams


def estimator_context(
    target: Target, chaser: ChaserConfig, mission: MissionConfig, sensors: SensorsConfig, streams: Streams
) -> EstimatorContext:
    """Return the context of the estimator of a mission.

    Args:
        target: The target.
        chaser: The chaser.
        mission: Rates of the mission.
        sensors: The sensors of the chaser.
        streams: Random streams of the mission. The samples of the estimator are independent of those of the mission
            and reveal nothing about them.
    """
    own = Streams(int(streams.bits("estimator")[0, 0]), np.zeros(1, np.int64), np.zeros(1, np.int64))
    return EstimatorContext(
        target=target,
        chaser=chaser,
        step=mission.step,
        camera=sensors.camera.geometry,
        T_BC=camera_mount(chaser),
        frame_period=sensors.frame_period,
        imu=sensors.imu,
        imu_period=sensors.imu_ticks * mission.tick,
        streams=own,
    )
