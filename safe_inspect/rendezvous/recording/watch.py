"""A simulated watch: the chaser holds its place and looks at the target, camera and inertial unit measure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.missions.mission import Mission
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.plugins import MeasuredState
from safe_inspect.rendezvous.sensing import pose_in_model
from safe_inspect.rendezvous.sensors.tof import DepthFrame
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
    """Yield the frames of a mission that does nothing but watch, the first at time 0.

    Args:
        config: The experiment; its estimator is not asked, and what fails in it works here.
        number: Number of the mission, whose tumble and noise are drawn.
        seconds: How long it lasts.
    """
    endless = dict.fromkeys(("observe", "observe_limit", "time_limit"), math.inf)
    mission = config.mission.model_copy(update={"faults": (), **endless})
    watching = config.model_copy(update={"mission": mission, "estimator": MeasuredState()})
    target, count = config.target(), 0
    samples: list[FloatArray] = []
    for readings, chaser, body in Mission(watching, number, reads=("frames", "inertial")).steps():
        if readings.time > seconds + 1e-6:
            return
        for _, acceleration, rate in readings.samples:
            count += 1
            time = count * config.sensors.imu_ticks * mission.tick
            samples.append(np.concatenate([[time], acceleration, rate]))
        if readings.frame is not None:
            rows = np.array(samples).reshape(-1, 7)
            yield WatchedFrame(readings.frame, rows, chaser, body, pose_in_model(target, chaser, body))
            samples = []
