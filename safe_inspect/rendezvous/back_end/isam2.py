"""Back end plugin: it estimates the states of chaser and target from relative poses and inertial measurements."""

from __future__ import annotations

from pydantic import Field

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.back_end.graph import PoseGraph
from safe_inspect.rendezvous.back_end.inertial import ImuBuffer
from safe_inspect.rendezvous.back_end.states import CentrePrior, ChaserStart
from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.units import NonNegativeDuration


class ISAM2BackEnd(Plugin):
    """Factor graph of inertial samples, relative poses and a centre of mass at rest in W, solved by iSAM2.

    Attributes:
        largest: Number of frames beyond which the older half is replaced by priors.
        memory: Correlation time of the errors of poses relative to the model [s]; 0 for independent errors.
    """

    largest: int = Field(default=600, ge=10)
    memory: NonNegativeDuration = 2.0  # type: ignore[valid-type]

    def __call__(self, imu: ImuNoise, period: float, start: ChaserStart, centre: CentrePrior) -> PoseGraph:
        """Return the back end for a mission.

        Args:
            imu: Errors of the inertial unit.
            period: Time between two of its samples [s].
            start: State of the chaser at frame 0.
            centre: Prior of the target's centre of mass.
        """
        return PoseGraph(ImuBuffer(imu, period), start, centre, largest=self.largest, memory=self.memory)
