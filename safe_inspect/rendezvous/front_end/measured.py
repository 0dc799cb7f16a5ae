"""A front end that passes on what a simulated sensor of poses has measured."""

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
    """Passes on the poses that the sensor ``sensors.poses`` measures; for tests and ablations in a simulation."""

    reads: ClassVar[Literal["frames", "poses"]] = "poses"

    def __call__(self, context: FrontEndContext) -> MeasuredPosesRun:
        """Return the front end of a mission."""
        return MeasuredPosesRun()


class MeasuredPosesRun:
    """The front end of one mission; it counts the frames by its calls, whatever the sensor's own numbers are."""

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {MODEL: MODEL}
        self._count = 0

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the poses of a frame.

        Raises:
            ConfigError: The frame is one of a camera.
        """
        number, self._count = self._count, self._count + 1
        if not isinstance(frame, PoseFrame):
            if not frame.depth.size:
                return []
            raise ConfigError("MeasuredPoses works in simulations only; choose another front end for depth frames")
        self._numbers[frame.number] = number
        return [replace(edge, first=self._numbers[edge.first], second=number) for edge in frame.poses]
