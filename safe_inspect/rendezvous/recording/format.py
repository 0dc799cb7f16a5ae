"""The names and columns of a sensor log's files, and the model of its description."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from safe_inspect.config.models.experiment import Model
from safe_inspect.plugins.functor import misplaced
from safe_inspect.rendezvous.poses import check_unit
from safe_inspect.rendezvous.sensors.imu import ImuNoise, checked_noise
from safe_inspect.rendezvous.sensors.tof import DepthCamera
from safe_inspect.units import Length, PositiveLength, Speed

#: Files with the description of the sensors, the list of the frames, and the truth; inertial samples as CSV or Parquet.
DESCRIPTION, FRAMES, TRUTH = "sensors.yml", "frames.csv", "truth.csv"
IMU_FILES = ("imu.csv", "imu.parquet")
FRAME_COLUMNS = ("time", "file")
IMU_COLUMNS = (
    "time",
    "acceleration_x", "acceleration_y", "acceleration_z",
    "angular_velocity_x", "angular_velocity_y", "angular_velocity_z",
)  # fmt: skip
TRUTH_COLUMNS = (
    "time",
    "T_MB_x", "T_MB_y", "T_MB_z", "q_MB_x", "q_MB_y", "q_MB_z", "q_MB_w",
    "q_WT_x", "q_WT_y", "q_WT_z", "q_WT_w", "rate_x", "rate_y", "rate_z",
)  # fmt: skip
#: Columns of each quantity in the truth.
TRUTH_PARTS = {"T_MB": slice(1, 4), "q_MB": slice(4, 8), "q_WT": slice(8, 12), "rate": slice(12, 15)}
#: Name of the array of depths in an NPZ file.
DEPTH = "depth"
_Point = tuple[Length, Length, Length]  # type: ignore[valid-type]
_Velocity = tuple[Speed, Speed, Speed]  # type: ignore[valid-type]
_Quaternion = tuple[float, float, float, float]


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Iterable[Any]], number: str = ".17g") -> None:
    """Write a CSV file.

    Args:
        path: The file.
        columns: Names of the columns.
        rows: Texts and numbers; NaN is left empty.
        number: Format of the numbers, by default with enough digits for every float64.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in rows:
            writer.writerow(
                [value if isinstance(value, str) else "" if value != value else format(value, number) for value in row]
            )


class CameraDescription(Model):
    """The depth camera: a pinhole camera without distortion.

    C has z forward, x right and y down. A depth is the coordinate z in C. (cx, cy) is 0 at the centre of the first
    pixel, as in OpenCV.

    Attributes:
        width: Number of pixels in a row.
        height: Number of pixels in a column.
        fx: Focal length along a row [px].
        fy: Focal length along a column [px].
        cx: Column of the principal point [px].
        cy: Row of the principal point [px].
        least_range: Range below which points are not used [m].
        largest_range: Range above which points are not used [m].
        depth_unit: Depth of the value 1 in a PNG file [m].
        position: Position of the camera in B [m].
        orientation: Quaternion [x, y, z, w] from C to B; by default the camera looks along x of B with y to the right.
    """

    width: int = Field(ge=8)
    height: int = Field(ge=8)
    fx: float = Field(gt=0.0)
    fy: float = Field(gt=0.0)
    cx: float
    cy: float
    least_range: PositiveLength = 0.2  # type: ignore[valid-type]
    largest_range: PositiveLength = 4.0  # type: ignore[valid-type]
    depth_unit: PositiveLength = 1e-3  # type: ignore[valid-type]
    position: _Point = (0.0, 0.0, 0.0)
    orientation: _Quaternion = (0.5, 0.5, 0.5, 0.5)

    @model_validator(mode="after")
    def _check(self) -> CameraDescription:
        check_unit("orientation", self.orientation)
        problems = [
            ((name,), f"{value:g} px is outside of the image, which has {count} pixels along it")
            for name, value, count in (("cx", self.cx, self.width), ("cy", self.cy, self.height))
            if not -0.5 <= value <= count - 0.5
        ]
        if problems:
            raise misplaced(problems)
        if self.least_range >= self.largest_range:
            raise ValueError(f"least_range ({self.least_range} m) must be below largest_range ({self.largest_range} m)")
        return self

    @property
    def geometry(self) -> DepthCamera:
        """The camera's geometry."""
        return DepthCamera(
            self.width, self.height, self.fx, self.least_range, self.largest_range,
            focal_length_y=self.fy, principal_point=(self.cx, self.cy),
        )  # fmt: skip


class StartDescription(Model):
    """The state of the chaser at the first frame, in an inertial frame W that the user chooses.

    Attributes:
        position: Position of the chaser in W [m].
        velocity: Velocity of the chaser in W [m/s].
        orientation: Quaternion [x, y, z, w] from B to W.
    """

    position: _Point = (0.0, 0.0, 0.0)
    velocity: _Velocity = (0.0, 0.0, 0.0)
    orientation: _Quaternion = (0.0, 0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _check(self) -> StartDescription:
        check_unit("orientation", self.orientation)
        return self


class SensorDescription(Model):
    """The sensors of a log.

    Attributes:
        camera: The depth camera.
        imu: Errors of the inertial unit, each as the standard deviation of one axis.
        start: The chaser at the first frame.
    """

    camera: CameraDescription
    imu: Annotated[ImuNoise, Field(default_factory=ImuNoise)]
    start: StartDescription = StartDescription()

    _check_imu = field_validator("imu")(checked_noise)
