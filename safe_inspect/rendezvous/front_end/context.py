"""Front ends: the plugin kind, what one is made with, and what it is asked for at each frame."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.edges import Edge
from safe_inspect.rendezvous.sensors.tof import DepthCamera, DepthFrame
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class FrontEndContext:
    """What is known before the first frame.

    Attributes:
        camera: Geometry of the depth camera.
        T_BC: Pose of the camera in the chaser's frame B, homogeneous matrix, shape (4, 4).
        target: The target where its shape is known, else None.
        streams: Random streams of the estimator's own.
    """

    camera: DepthCamera
    T_BC: FloatArray
    target: Target | None
    streams: Streams


class FrontEndRun(Protocol):
    """The front end of one mission. Frames are counted by the calls of `step`: 0, 1, 2, ..."""

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the relative poses that a frame gives; a frame without any gives an empty list, and still counts.

        Args:
            frame: The frame.
            predicted: T_GB of this frame as the back end predicts it, shape (4, 4); None without a prediction.
            rotation: R_B'B from the gyro, from B now to B' at the last call, shape (3, 3).
        """


class FrontEnd(Plugin):
    """Base of front ends: from depth frames to relative poses of the target.

    Attributes:
        reads: ``frames`` of a depth camera, or ``poses`` that a simulated sensor measures in their place.
    """

    kind: ClassVar[str] = "front_end"
    reads: ClassVar[Literal["frames", "poses"]] = "frames"

    @abstractmethod
    def __call__(self, context: FrontEndContext) -> FrontEndRun:
        """Return the front end of a mission."""
