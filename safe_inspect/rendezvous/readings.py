"""`Readings`: what the sensors of a chaser give at a step of control. Estimators get these and no truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.sensors.imu import InertialSample
from safe_inspect.rendezvous.sensors.state import StateReading
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.types import FloatArray

#: What an estimator may read: depth frames, measured poses in their place, inertial samples, measured states.
Reading = Literal["frames", "poses", "inertial", "state"]


class Command(NamedTuple):
    """What the actuators are told.

    Attributes:
        force: In B [N], shape (3,).
        torque: In B [N m], shape (3,).
    """

    force: FloatArray
    torque: FloatArray


@dataclass(frozen=True, eq=False)
class Readings:
    """What the sensors give at a step of control. A sensor that an estimator does not read gives nothing.

    Attributes:
        time: The time [s].
        start: The chaser's own state at the first step, as it is told; None later.
        frame: The depth frame that is taken now; None between frames and where the camera is silent.
        samples: What the inertial unit has measured since the last step, in order; none where it was silent.
        command: The command that was held since the last step; None at the first.
        state: What a sensor of states gives.
        silent: The sensors that do not answer now: ``camera``, ``imu``.
    """

    time: float
    start: BodyState | None = None
    frame: DepthFrame | None = None
    samples: tuple[InertialSample, ...] = ()
    command: Command | None = None
    state: StateReading | None = None
    silent: frozenset[str] = frozenset()
