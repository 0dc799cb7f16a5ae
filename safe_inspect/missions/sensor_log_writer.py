"""Recording the sensors of a simulated observation, in which the chaser holds its position and looks at the target."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from safe_inspect.dynamics.quaternion import from_matrix
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.sensor_log import (
    DEPTH,
    DESCRIPTION,
    FRAME_COLUMNS,
    FRAMES,
    IMU,
    IMU_COLUMNS,
    TRUTH,
    TRUTH_COLUMNS,
    CameraDescription,
    SensorDescription,
    StartDescription,
    write_table,
)
from safe_inspect.missions.truth import pose_in_model
from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.experiment import RendezvousConfig
from safe_inspect.rendezvous.plugins import MeasuredState
from safe_inspect.types import FloatArray


class SensorLogWriter:
    """Writer of a sensor log into an existing folder; `close` writes the tables.

    Args:
        folder: The existing folder.
        description: The sensors.
    """

    def __init__(self, folder: Path, description: SensorDescription) -> None:
        self._folder, self._description = folder, description
        self._frames: list[tuple[float, str]] = []
        self._imu: list[FloatArray] = []
        self._truth: list[FloatArray] = []
        (folder / "frames").mkdir()

    def add_frame(self, time: float, depth: FloatArray) -> None:
        """Add a depth frame: z in C [m], 0 where nothing is seen, shape (height, width)."""
        name = f"frames/{len(self._frames):06d}.npz"
        np.savez_compressed(self._folder / name, **{DEPTH: depth.astype(np.float32)})  # type: ignore[arg-type]
        self._frames.append((time, name))

    def add_imu(self, samples: FloatArray) -> None:
        """Add inertial samples: time [s], specific force [m/s^2] and angular velocity [rad/s] in B, shape (n, 7)."""
        self._imu.extend(samples)

    def add_truth(self, row: FloatArray) -> None:
        """Add the truth of the last frame, in the order of `TRUTH_COLUMNS`."""
        self._truth.append(row)

    def close(self) -> None:
        """Write the description and the tables."""
        described = yaml.safe_dump(self._description.model_dump(mode="json"), sort_keys=False)
        text = f"# Sensors of this log; lengths in m, times in s, angles in rad.\n{described}"
        (self._folder / DESCRIPTION).write_text(text, encoding="utf-8")
        write_table(self._folder / FRAMES, FRAME_COLUMNS, self._frames)
        write_table(self._folder / IMU, IMU_COLUMNS, self._imu)
        if self._truth:
            write_table(self._folder / TRUTH, TRUTH_COLUMNS, self._truth)


@dataclass(frozen=True, eq=False)
class WatchedFrame:
    """A frame, the inertial samples since the previous frame, and the true states.

    Attributes:
        frame: The depth frame.
        imu: Time [s], specific force [m/s^2] and angular velocity [rad/s] in B of each sample, shape (n, 7).
        chaser: The chaser's true state.
        target: The target's true state, in its principal axes T.
        T_MB: The true pose of the chaser in the target's model frame M, shape (4, 4).
    """

    frame: DepthFrame
    imu: FloatArray
    chaser: BodyState
    target: BodyState
    T_MB: FloatArray


def watch(config: RendezvousConfig, number: int, seconds: float) -> Iterator[WatchedFrame]:
    """Yield the frames of a mission that only observes the target, the first at time 0.

    Args:
        config: The experiment. Its estimator is not used, and its faults are not simulated.
        number: Number of the mission, from which its tumble and noise are sampled.
        seconds: Duration of the observation [s].
    """
    endless = dict.fromkeys(("observe", "observe_limit", "time_limit"), math.inf)
    mission = config.mission.model_copy(update={"faults": (), **endless})
    watching = config.model_copy(update={"mission": mission, "estimator": MeasuredState()})
    target, count = config.target(), 0
    samples: list[FloatArray] = []
    for readings, chaser, body in Mission(watching, number, reads=("frames", "inertial")).steps():
        if readings.time > seconds + 1e-6:
            return
        for _, acceleration, rate in readings.samples:
            count += 1
            time = count * config.sensors.imu_ticks * mission.tick
            samples.append(np.concatenate([[time], acceleration, rate]))
        if readings.frame is not None:
            rows = np.array(samples).reshape(-1, 7)
            yield WatchedFrame(readings.frame, rows, chaser, body, pose_in_model(target, chaser, body))
            samples = []


def _describe_watch(config: RendezvousConfig, start: BodyState) -> SensorDescription:
    """Return the description of the sensors of a simulated observation."""
    camera = config.sensors.camera.geometry
    fx, fy, cx, cy = camera.intrinsics
    at_start = {name: tuple(getattr(start, name).tolist()) for name in StartDescription.model_fields}
    return SensorDescription(
        camera=CameraDescription(
            width=camera.width, height=camera.height, fx=fx, fy=fy, cx=cx, cy=cy, least_range=camera.least_range,
            largest_range=camera.largest_range, position=config.chaser.camera_position,
        ),
        imu=config.sensors.imu,
        start=StartDescription(**at_start),
    )  # fmt: skip


def record_watch(
    folder: Path,
    config: RendezvousConfig,
    number: int,
    seconds: float,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the sensor log of a simulated observation into an existing folder and return the number of frames.

    Args:
        folder: The existing folder.
        config: The experiment.
        number: Number of the mission, from which its tumble and noise are sampled.
        seconds: Duration of the observation [s].
        progress: Called after each frame with the number of frames that are done and the number of all frames.
    """
    wanted = int(seconds / config.sensors.frame_period + 1e-9) + 1
    frames = watch(config, number, seconds)
    first = next(frames)
    writer = SensorLogWriter(folder, _describe_watch(config, first.chaser))
    for count, seen in enumerate(itertools.chain([first], frames), 1):
        writer.add_imu(seen.imu)
        writer.add_frame(seen.frame.time, seen.frame.depth)
        position, orientation = seen.T_MB[:3, 3], from_matrix(seen.T_MB[:3, :3])
        target = (seen.target.orientation, seen.target.angular_velocity)
        writer.add_truth(np.concatenate([[seen.frame.time], position, orientation, *target]))
        if progress is not None:
            progress(count, wanted)
    writer.close()
    return count
