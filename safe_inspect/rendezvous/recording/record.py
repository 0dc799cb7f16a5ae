"""Recording the sensors of a simulated observation of the target."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from safe_inspect.dynamics.quaternion import from_matrix
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.recording.format import CameraDescription, SensorDescription, StartDescription
from safe_inspect.rendezvous.recording.watch import WatchedFrame, watch
from safe_inspect.rendezvous.recording.writer import SensorLogWriter
from safe_inspect.types import FloatArray


def describe_watch(config: RendezvousConfig, first: WatchedFrame) -> SensorDescription:
    """Return the description of the sensors of a simulated observation."""
    camera = config.sensors.camera.geometry
    fx, fy, cx, cy = camera.intrinsics
    start = first.chaser
    return SensorDescription(
        camera=CameraDescription(
            width=camera.width, height=camera.height, fx=fx, fy=fy, cx=cx, cy=cy,
            least_range=camera.least_range, largest_range=camera.largest_range,
            position=config.chaser.camera_position, orientation=_tuple(from_matrix(R_BC)),
        ),
        imu=config.sensors.imu,
        start=StartDescription(
            position=_tuple(start.position), velocity=_tuple(start.velocity), orientation=_tuple(start.orientation)
        ),
    )  # fmt: skip


def record_watch(
    folder: Path,
    config: RendezvousConfig,
    number: int,
    seconds: float,
    images: Literal["npz", "png"] = "npz",
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the sensor log of a simulated observation into an existing folder and return the number of frames.

    Args:
        folder: The existing folder.
        config: The experiment.
        number: Number of the mission, from which its tumble and noise are sampled.
        seconds: Duration of the observation [s].
        images: Format of the depth frames.
        progress: Called after each frame with the number of frames that are done and the number of all frames.
    """
    count, wanted = 0, int(seconds / config.sensors.frame_period + 1e-9) + 1
    writer: SensorLogWriter | None = None
    for seen in watch(config, number, seconds):
        if writer is None:
            writer = SensorLogWriter(folder, describe_watch(config, seen), images)
        writer.add_imu(seen.imu)
        writer.add_frame(seen.frame.time, seen.frame.depth)
        writer.add_truth(_truth(seen))
        count += 1
        if progress is not None:
            progress(count, wanted)
    assert writer is not None, "an observation must start with a frame"
    writer.close()
    return count


def _truth(seen: WatchedFrame) -> FloatArray:
    return np.concatenate(
        [
            [seen.frame.time],
            seen.T_MB[:3, 3],
            from_matrix(seen.T_MB[:3, :3]),
            seen.target.orientation,
            seen.target.angular_velocity,
        ]
    )


def _tuple(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
