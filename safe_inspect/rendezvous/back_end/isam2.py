"""The back end: relative poses and inertial measurements to the states of chaser and target."""

from __future__ import annotations

from pydantic import Field

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.back_end.graph import PoseGraph
from safe_inspect.rendezvous.back_end.inertial import ImuBuffer
from safe_inspect.rendezvous.back_end.states import CentrePrior, ChaserStart
from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.units import NonNegativeDuration


class ISAM2BackEnd(Plugin):
    """A factor graph that iSAM2 solves: inertial, relative poses, and a centre of mass that rests in W.

    Attributes:
        largest: Number of frames beyond which the older half is replaced by priors.
        memory: Time over which errors of poses to the model stay alike [s]; 0 for independent ones.
    """

    largest: int = Field(default=600, ge=10)
    memory: NonNegativeDuration = 2.0  # type: ignore[valid-type]

    def __call__(self, imu: ImuNoise, period: float, start: ChaserStart, centre: CentrePrior) -> PoseGraph:
        """Return the back end of a mission that starts at frame 0, with samples of the unit every `period` [s]."""
        return PoseGraph(ImuBuffer(imu, period), start, centre, largest=self.largest, memory=self.memory)
