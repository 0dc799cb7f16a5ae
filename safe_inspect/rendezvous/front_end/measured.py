"""Front end that returns the poses that a simulated sensor measures."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Literal

from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.edges import MODEL, Edge
from safe_inspect.rendezvous.front_end.context import FrontEnd, FrontEndContext
from safe_inspect.rendezvous.sensors.poses import PoseFrame
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.types import FloatArray


class MeasuredPoses(FrontEnd):
    """Front end that returns the poses measured by ``sensors.poses``; for tests and ablations in a simulation."""

    reads: ClassVar[Literal["frames", "poses"]] = "poses"

    def __call__(self, context: FrontEndContext) -> MeasuredPosesRun:
        """Return the front end for a mission."""
        return MeasuredPosesRun()


class MeasuredPosesRun:
    """Front end of one mission; it numbers the frames by its calls and not by the numbers of the sensor."""

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {MODEL: MODEL}
        self._count = 0

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the poses of a frame.

        Raises:
            ConfigError: The frame is from a camera.
        """
        number, self._count = self._count, self._count + 1
        if not isinstance(frame, PoseFrame):
            if not frame.depth.size:
                return []
            raise ConfigError("MeasuredPoses works in simulations only; choose another front end for depth frames")
        self._numbers[frame.number] = number
        return [replace(edge, first=self._numbers[edge.first], second=number) for edge in frame.poses]
