"""A factor graph and the inertial measurements that drive it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.back_end.graph import PoseGraph
from safe_inspect.rendezvous.back_end.inertial import BiasJump, ImuBuffer
from safe_inspect.rendezvous.back_end.states import CentrePrior, ChaserStart, GraphEstimate
from safe_inspect.rendezvous.edges import Edge
from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration


class ISAM2BackEnd(Plugin):
    """A factor graph that iSAM2 solves: inertial, relative poses, and a centre of mass that rests in W.

    Attributes:
        largest: Number of frames beyond which the older half is replaced by priors.
        memory: Time over which errors of poses to the model stay alike [s]; 0 for independent ones.
    """

    largest: int = Field(default=600, ge=10)
    memory: NonNegativeDuration = 2.0  # type: ignore[valid-type]

    def __call__(self, imu: ImuNoise, period: float, start: ChaserStart, centre: CentrePrior) -> GraphBackEnd:
        """Return the back end of a mission that starts at frame 0, with samples of the unit every `period` [s]."""
        graph = PoseGraph(imu, start, centre, largest=self.largest, memory=self.memory)
        return GraphBackEnd(ImuBuffer(imu, period), graph)


class GraphBackEnd:
    """The back end of one mission; frames are those of the front end, in ascending order.

    Args:
        buffer: Integrates the inertial samples between frames.
        graph: The factor graph.
    """

    def __init__(self, buffer: ImuBuffer, graph: PoseGraph) -> None:
        self._buffer, self._graph = buffer, graph

    @property
    def frames(self) -> tuple[int, ...]:
        """The frames of the graph, in ascending order."""
        return self._graph.frames

    @property
    def rotation(self) -> FloatArray:
        """R_B'B by the gyroscopes, from B now to B' at the last frame, shape (3, 3)."""
        return self._buffer.rotation

    def measure(self, acceleration: FloatArray, rate: FloatArray, period: float) -> None:
        """Take a sample of the inertial unit, in B, at the end of a period [s]."""
        self._buffer.add(acceleration, rate, period)

    def coast(self, period: float, commanded: FloatArray) -> None:
        """Take a period without a sample as flown as commanded; see `ImuBuffer.coast`."""
        self._buffer.coast(period, commanded)

    def correct(self, jump: BiasJump) -> None:
        """Take the biases as changed by a jump from the next sample on; see `ImuBuffer.correct`."""
        self._buffer.correct(jump)

    def update(self, frame: int, edges: Sequence[Edge], *, jumped: bool = False) -> None:
        """Add a frame at the time of the last sample."""
        self._graph.update(frame, edges, self._buffer, jumped=jumped)

    def estimate(self) -> GraphEstimate:
        """Return what is known at the last frame."""
        return self._graph.estimate()

    def now(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return T_WB (4, 4), the velocity in W (3,) and the angular velocity in B (3,) at the last sample."""
        pose, velocity = self._buffer.predict(*self._graph.last)
        rate = self._buffer.last_rate - self._graph.last[2].gyroscope()
        return pose.matrix(), np.asarray(velocity), np.asarray(rate)

    def chaser_poses(self, newest: int | None = None) -> FloatArray:
        """Return T_WB of all frames or of the newest, smoothed, shape (F, 4, 4)."""
        return self._graph.chaser_poses(newest)

    def relative_poses(self, newest: int | None = None) -> dict[int, FloatArray]:
        """Return T_GB, smoothed, of those of all frames or of the newest that an edge has reached."""
        return self._graph.relative_poses(newest)
