"""A simulated watch: the chaser holds its place and looks at the target, camera and inertial unit measure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.control.attitude import AttitudeController, CameraPointing
from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.lqr import LQRTrackerRun
from safe_inspect.rendezvous.control.tightening import TrackedReference
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.mission import dynamics_of
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.scenario import mission_streams
from safe_inspect.rendezvous.sensors.suite import SensorSuite, pose_in_model
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.rendezvous.truth import MissionTruth
from safe_inspect.types import FloatArray


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


def watch(config: RendezvousConfig, number: int, seconds: float) -> Iterator[WatchedFrame]:
    """Yield the frames of a watch, the first at time 0; the chaser holds its place by its true state.

    Args:
        config: The experiment; what fails in it works here.
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
    working = mission.model_copy(update={"faults": ()})
    suite = SensorSuite(config.sensors, chaser, working, target, streams, ("frames", "inertial"))
    reference = TrackedReference(position[None], np.zeros((1, 3)))
    count, history = 0, None
    samples: list[FloatArray] = []
    for _ in range(round(seconds / mission.step) + 1):
        now, body = truth.chaser, truth.target
        readings = suite.read(truth.time, now, body, history)
        for _, acceleration, rate in readings.samples:
            count += 1
            time = count * config.sensors.imu_ticks * mission.tick
            samples.append(np.concatenate([[time], acceleration, rate]))
        if readings.frame is not None:
            rows = np.array(samples).reshape(-1, 7)
            yield WatchedFrame(readings.frame, rows, now, body, pose_in_model(target, now, body))
            samples = []
        force = hold.step(np.concatenate([now.position, now.velocity]), reference, 0).force
        command = pointing.step(now.position, np.zeros(3), mission.step)
        history = truth.advance(force, controller(now.orientation, now.angular_velocity, command)).chaser
