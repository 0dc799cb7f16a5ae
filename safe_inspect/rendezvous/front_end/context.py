"""Front ends: the plugin kind, the context of a front end, and its interface at each frame."""

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
    """Information that is available before the first frame.

    Attributes:
        camera: Geometry of the depth camera.
        T_BC: Pose of the camera in the chaser's frame B, homogeneous matrix, shape (4, 4).
        target: The target, None if its shape is not known.
        streams: Random streams that only the estimator uses.
    """

    camera: DepthCamera
    T_BC: FloatArray
    target: Target | None
    streams: Streams


class FrontEndRun(Protocol):
    """Front end of one mission. Frames are numbered by the calls of `step`: 0, 1, 2, ..."""

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the relative poses found in a frame; the list may be empty, and the frame still counts.

        Args:
            frame: The frame.
            predicted: T_GB of this frame predicted by the back end, shape (4, 4); None without a prediction.
            rotation: R_B'B from the gyro, from B now to B' at the previous call, shape (3, 3).
        """


class FrontEnd(Plugin):
    """Base class of front ends, which compute relative poses of the target from depth frames.

    Attributes:
        reads: ``frames`` of a depth camera, or ``poses`` that a simulated sensor measures instead.
    """

    kind: ClassVar[str] = "front_end"
    reads: ClassVar[Literal["frames", "poses"]] = "frames"

    @abstractmethod
    def __call__(self, context: FrontEndContext) -> FrontEndRun:
        """Return the front end for a mission."""
