"""A simulated observation: the chaser holds its position and points its camera at the target."""

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
    """A frame, the inertial samples since the previous frame, and the true states.

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
    """Yield the frames of a mission that only observes the target, the first at time 0.

    Args:
        config: The experiment. Its estimator is not used, and its faults are not simulated.
        number: Number of the mission, from which its tumble and noise are sampled.
        seconds: Duration of the observation [s].
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
