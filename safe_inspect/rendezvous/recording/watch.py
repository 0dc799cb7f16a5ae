"""A simulated watch: the chaser holds its place and looks at the target, camera and inertial unit measure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.rendezvous.control.attitude import AttitudeController, CameraPointing
from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.lqr import LQRTrackerRun
from safe_inspect.rendezvous.control.tightening import TrackedReference
from safe_inspect.rendezvous.estimate import BodyState, EstimatorContext, InertialTruth
from safe_inspect.rendezvous.estimation.suite import SensorSuite
from safe_inspect.rendezvous.mission import dynamics_of
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.scenario import mission_streams
from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.rendezvous.sensors.tof import DepthFrame, TimeOfFlightCamera
from safe_inspect.rendezvous.truth import MissionTruth
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class WatchSensors:
    """What a watch measures with.

    Attributes:
        camera: The depth camera.
        imu: Errors of the inertial unit.
        imu_ticks: Ticks of the truth between two of its samples.
        period: Time between two frames, a multiple of the step of control [s].
    """

    camera: TimeOfFlightCamera
    imu: ImuNoise = field(default_factory=ImuNoise)
    imu_ticks: int = 2
    period: float = 0.2


@dataclass(frozen=True, eq=False)
class WatchedFrame:
    """One frame, what the inertial unit has measured since the last one, and the truth.

    Attributes:
        frame: The depth frame.
        imu: Time [s], specific force [m/s^2] and angular velocity [rad/s] in B of each sample, shape (n, 7).
        chaser: The chaser's true state.
        target: The target's true state, in its principal axes T.
        T_MB: The true pose of the chaser in the target's model frame M, shape (4, 4).
    """

    frame: DepthFrame
    imu: FloatArray
    chaser: BodyState
    target: BodyState
    T_MB: FloatArray


def watch(config: RendezvousConfig, sensors: WatchSensors, number: int, seconds: float) -> Iterator[WatchedFrame]:
    """Yield the frames of a watch, the first at time 0; the chaser holds its place by its true state.

    Args:
        config: The experiment.
        sensors: What measures.
        number: Number of the mission, whose tumble and noise are drawn.
        seconds: How long it lasts.
    """
    streams = mission_streams(config, number)
    mission, chaser, target = config.mission, config.chaser, config.target()
    position = np.array(chaser.position)
    level = CameraPointing(np.array([0.0, 0.0, 0.0, 1.0])).step(position, np.zeros(3), 1.0).orientation
    pointing, controller = CameraPointing(level), AttitudeController(np.array(chaser.inertia), chaser.limits.torque)
    hold = LQRTrackerRun(Axis(chaser.mass, mission.step), chaser.limits.force)
    start = BodyState(position, np.array(chaser.velocity), level, np.zeros(3))
    truth = MissionTruth(
        dynamics_of(config),
        start,
        target.principal,
        config.tumble(streams),
        mission.tick,
        mission.control_ticks,
        streams,
    )
    context = EstimatorContext(
        target, mission.update_period, mission.step, streams, mission.tick, chaser.mass, chaser.camera_position
    )
    suite = SensorSuite(context, sensors.camera, sensors.imu, sensors.imu_ticks, render=True)
    reference = TrackedReference(position[None], np.zeros((1, 3)))
    every, count = max(round(sensors.period / mission.step), 1), 0
    samples: list[FloatArray] = []
    for step in range(round(seconds / mission.step) + 1):
        now, body = truth.chaser, truth.target
        if step % every == 0:
            rows = np.array(samples).reshape(-1, 7)
            yield WatchedFrame(suite.frame(truth.time, now, body), rows, now, body, suite.pose_in_model(now, body))
            samples = []
        force = hold.step(np.concatenate([now.position, now.velocity]), reference, 0).force
        command = pointing.step(now.position, np.zeros(3), mission.step)
        torque = controller(now.orientation, now.angular_velocity, command)
        history = truth.advance(force, torque).chaser
        for _, acceleration, rate in suite.samples(InertialTruth(history, False, np.zeros(6))):
            count += 1
            samples.append(np.concatenate([[count * suite.period], acceleration, rate]))
