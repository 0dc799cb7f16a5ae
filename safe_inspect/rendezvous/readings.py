"""`Readings`: the measurements of a control step, all that an estimator and a pilot read while they fly.

Of the truth they have only the chaser's state at the first step (`Readings.start`), and what the sensor of states
measures if the estimator reads it: the chaser's state exactly, the target's with the configured errors (none by
default). What is known before: `EstimatorContext` to an estimator, and `PilotConfig` and the arguments of `Pilot` to a
pilot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.inertial_unit import InertialSample
from safe_inspect.rendezvous.measured_poses import StateReading
from safe_inspect.types import FloatArray

#: What an estimator may read: depth frames, measured poses instead of frames, inertial samples, measured
#: states, and the mating point as an operator marks it in frames.
Reading = Literal["frames", "poses", "inertial", "state", "mark"]


class Command(NamedTuple):
    """The commanded force and torque.

    Attributes:
        force: Force in B [N], shape (3,).
        torque: Torque in B [N m], shape (3,).
    """

    force: FloatArray
    torque: FloatArray


@dataclass(frozen=True, eq=False)
class Readings:
    """The measurements of a control step. A sensor that the estimator does not read measures nothing.

    Attributes:
        time: Time of the control step [s].
        start: The chaser's true state at the first step; None later.
        frame: The depth frame of this step; None between frames and while the camera is silent.
        samples: The inertial samples since the last step, in order; empty if the inertial unit was silent.
        command: The command that was held since the last step; None at the first step.
        state: The measurement of the sensor of states; None without one.
        mark: The mating point in B as an operator marks it in the frame of this step [m], shape (3,); None if the
            frame does not show the place.
        silent: The sensors that do not respond now: ``camera``, ``imu``.
    """

    time: float
    start: BodyState | None = None
    frame: DepthFrame | None = None
    samples: tuple[InertialSample, ...] = ()
    command: Command | None = None
    state: StateReading | None = None
    mark: FloatArray | None = None
    silent: frozenset[str] = frozenset()

    def in_units_of(self, length: float) -> Readings:
        """Return what is read of chaser, frame, inertial unit and mark with all lengths divided by a length [m]."""
        return replace(
            self,
            start=None if self.start is None else self.start.in_units_of(length),
            frame=None if self.frame is None else self.frame.in_units_of(length),
            samples=tuple(sample._replace(acceleration=sample.acceleration / length) for sample in self.samples),
            command=None if self.command is None else self.command._replace(force=self.command.force / length),
            mark=None if self.mark is None else self.mark / length,
        )
