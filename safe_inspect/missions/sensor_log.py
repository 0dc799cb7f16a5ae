"""The format of a sensor log, and reading one. The message for a mistake states the file, the line and what to do."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import LocatedDict
from safe_inspect.config.models import Model
from safe_inspect.config.report import validated
from safe_inspect.dynamics.quaternion import normalise, to_matrix
from safe_inspect.errors import UNREADABLE_ARRAYS, ConfigError, Location, Problem
from safe_inspect.plugins.functor import misplaced
from safe_inspect.rendezvous.depth_camera import DepthCamera, DepthFrame
from safe_inspect.rendezvous.inertial_unit import ImuNoise, checked_noise
from safe_inspect.rendezvous.poses import pose
from safe_inspect.types import FloatArray
from safe_inspect.units import Length, PositiveLength, Speed

#: Files with the description of the sensors, the list of the frames, the inertial samples and the truth.
DESCRIPTION, FRAMES, IMU, TRUTH = "sensors.yml", "frames.csv", "imu.csv", "truth.csv"
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


def _checked_unit(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return a quaternion [x, y, z, w] after checking that it is a unit quaternion."""
    length = math.hypot(*quaternion)
    if abs(length - 1.0) > 1e-3:
        raise ValueError(f"orientation is not a unit quaternion [x, y, z, w]: its length is {length:.6g}")
    return quaternion


_Quaternion = Annotated[tuple[float, float, float, float], AfterValidator(_checked_unit)]


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


@dataclass(frozen=True, eq=False)
class SensorLog:
    """A sensor log. Its tables are in memory, and its frames are read one by one.

    Attributes:
        folder: The folder of the log.
        description: The sensors.
        times: Times of the frames [s], shape (n,).
        files: The frames' files.
        imu: Time [s], specific force [m/s^2] and angular velocity [rad/s] in B, shape (m, 7).
        truth: Rows of `TRUTH_COLUMNS`, shape (n, 15); None where the log has none.
    """

    folder: Path
    description: SensorDescription
    times: FloatArray
    files: tuple[str, ...]
    imu: FloatArray
    truth: FloatArray | None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def T_BC(self) -> FloatArray:  # noqa: N802
        """Pose of the camera in B, shape (4, 4)."""
        return _pose(self.description.camera)

    @property
    def start(self) -> tuple[FloatArray, FloatArray]:
        """T_WB, shape (4, 4), and velocity in W [m/s], shape (3,), of the chaser at the first frame."""
        start = self.description.start
        return _pose(start), np.array(start.velocity)

    def steps(self) -> Iterator[tuple[DepthFrame, FloatArray]]:
        """Yield each frame with the inertial samples since the previous frame, shape (k, 7).

        Samples before the first frame are left out: the chaser's state is given at the first frame.

        Raises:
            ConfigError: A frame's file is missing, damaged or of another size.
        """
        first = int(np.searchsorted(self.imu[:, 0], self.times[0], side="right"))
        for index, time in enumerate(self.times):
            last = max(int(np.searchsorted(self.imu[:, 0], time + 1e-9, side="right")), first)
            yield self.frame(index), self.imu[first:last]
            first = last

    def frame(self, index: int) -> DepthFrame:
        """Return a frame by its number.

        Raises:
            ConfigError: Its file is missing, damaged or of another size.
        """
        camera, depth = self.description.camera, self.depth(index)
        directions = camera.geometry.directions
        ranges = depth / directions[..., 2]
        valid = (ranges >= camera.least_range) & (ranges <= camera.largest_range)
        points = directions[valid] * ranges[valid][:, None]
        flags = ("out_of_view",) if not len(points) else ()
        return DepthFrame(float(self.times[index]), np.where(valid, depth, 0.0), points, valid, flags)

    def depth(self, index: int) -> FloatArray:
        """Return the depths in the file of a frame, 0 where nothing is seen [m], shape (height, width).

        Raises:
            ConfigError: Its file is missing, damaged or of another size.
        """
        camera, name = self.description.camera, self.files[index]
        depth = _depth(self.folder / name, camera.depth_unit)
        if depth.shape != (camera.height, camera.width):
            found = f"the image has {depth.shape[1] if depth.ndim == 2 else '?'} x {depth.shape[0]} pixels"
            hint = f"{DESCRIPTION} says {camera.width} x {camera.height}; correct one of them"
            raise _frame_error(self.folder / name, found, hint)
        return np.where(np.isfinite(depth), depth, 0.0)


def _pose(described: CameraDescription | StartDescription) -> FloatArray:
    return pose(to_matrix(normalise(np.array(described.orientation))), np.array(described.position))


def read_sensor_log(folder: str | os.PathLike[str]) -> SensorLog:
    """Read a sensor log from its folder.

    Raises:
        ConfigError: The log is not valid; the error lists every mistake of the description, or the first one of the
            tables.
    """
    path = Path(folder)
    if not path.is_dir():
        raise ConfigError(f"{folder}: there is no such folder; give the folder of a sensor log")
    if not (path / DESCRIPTION).is_file():
        raise ConfigError(
            f"{folder}: not a sensor log: there is no {DESCRIPTION}; see docs/rendezvous.md for the format"
        )
    description = _description(path / DESCRIPTION)
    times, files = _frames(path / FRAMES)
    imu = _table(path / IMU, IMU_COLUMNS)
    _check_times(path / IMU, imu[:, 0])
    truth = _table(path / TRUTH, TRUTH_COLUMNS) if (path / TRUTH).is_file() else None
    if truth is not None and len(truth) != len(times):
        raise ConfigError(
            f"{path / TRUTH}: it has {len(truth)} rows for {len(times)} frames; give one row for each, or delete it"
        )
    return SensorLog(path, description, times, files, imu, truth)


def _description(path: Path) -> SensorDescription:
    tree = load(path)
    if not isinstance(tree, LocatedDict):
        raise ConfigError(f"{path}: it must contain the keys `camera`, `imu` and `start`")
    return validated(SensorDescription, tree)


def _frames(path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    rows = _rows(path, FRAME_COLUMNS)
    times = np.array([_number(path, line, "time", row[0]) for line, row in rows])
    if len(times) < 2:
        raise ConfigError(f"{path}: it lists {len(times)} frames; at least two are needed")
    _check_times(path, times)
    for line, row in rows:
        if not (path.parent / row[1]).is_file():
            raise _line_error(path, line, f"there is no file {row[1]!r}", "paths are relative to the log's folder")
    return times, tuple(row[1] for _, row in rows)


def _table(path: Path, columns: Sequence[str]) -> FloatArray:
    """Return a table of numbers in the order of the columns."""
    rows = _rows(path, columns)
    table = [[_number(path, line, name, value) for name, value in zip(columns, row, strict=True)] for line, row in rows]
    return np.array(table, dtype=np.float64).reshape(-1, len(columns))


def _rows(path: Path, columns: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Return the line number and the values of each row of a CSV file, in the order of the columns."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: it cannot be read ({error}); a sensor log needs it") from None
    reader = csv.reader(text.splitlines())
    header = [name.strip() for name in next(reader, [])]
    missing = [name for name in columns if name not in header]
    if missing:
        raise _line_error(path, 1, f"the column `{missing[0]}` is missing", f"the header needs {', '.join(columns)}")
    places = [header.index(name) for name in columns]
    rows = []
    for row in reader:
        if not row:
            continue
        if len(row) != len(header):
            raise _line_error(path, reader.line_num, f"{len(row)} values for {len(header)} columns", "complete the row")
        rows.append((reader.line_num, [row[place].strip() for place in places]))
    return rows


def _number(path: Path, line: int, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise _line_error(path, line, f"`{name}` is {text!r}", "give a finite number, or leave the row out")
    return value


def _check_times(path: Path, times: FloatArray) -> None:
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if len(back):
        row = int(back[0]) + 1
        raise ConfigError(
            f"{path}: row {row}: the time {times[row]:g} s does not come after {times[row - 1]:g} s; sort the rows"
        )


def _depth(path: Path, unit: float) -> FloatArray:
    """Return the depths of a file [m]."""
    kind = path.suffix.lower()
    if kind not in (".npz", ".png"):
        raise _frame_error(path, f"the file type {path.suffix!r} is not supported", "give NPZ or 16-bit PNG files")
    try:
        return _npz_depth(path) if kind == ".npz" else _png_depth(path) * unit
    except (*UNREADABLE_ARRAYS, SyntaxError) as error:
        hint = "write it with numpy.savez" if kind == ".npz" else "write a PNG with one channel of 16 bits"
        raise _frame_error(path, f"it cannot be read ({error})", hint) from None


def _npz_depth(path: Path) -> FloatArray:
    with np.load(path, allow_pickle=False) as arrays:
        if DEPTH not in arrays:
            raise _frame_error(path, f"it has no array `{DEPTH}`", f"it has {', '.join(arrays.files)}; rename one")
        return np.asarray(arrays[DEPTH], dtype=np.float64)


def _png_depth(path: Path) -> FloatArray:
    from PIL import Image

    with Image.open(path) as image:
        if not image.mode.startswith("I"):
            raise _frame_error(path, f"its pixels are {image.mode!r}", "write one channel of 16 bits")
        return np.asarray(image, dtype=np.float64)


def _frame_error(path: Path, message: str, hint: str) -> ConfigError:
    return ConfigError(Problem(f"{path}: {message}", hint=hint))


def _line_error(path: Path, line: int, message: str, hint: str) -> ConfigError:
    return ConfigError(Problem(message, location=Location(str(path), line), hint=hint))
