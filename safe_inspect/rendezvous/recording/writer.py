"""Writing a sensor log to disk."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import yaml

from safe_inspect.rendezvous.recording.format import (
    DEPTH,
    DESCRIPTION,
    FRAME_COLUMNS,
    FRAMES,
    IMU_COLUMNS,
    IMU_FILES,
    TRUTH,
    TRUTH_COLUMNS,
    SensorDescription,
)
from safe_inspect.types import FloatArray

#: Digits of a number in a CSV file: enough for every float64.
_NUMBER = ".17g"


class SensorLogWriter:
    """Writer of a sensor log into an existing folder; `close` writes the tables.

    Args:
        folder: The existing folder.
        description: The sensors.
        images: Format of depth frames: ``npz`` (float32, metres) or ``png`` (16 bits, rounded to `depth_unit`).
    """

    def __init__(self, folder: Path, description: SensorDescription, images: Literal["npz", "png"] = "npz") -> None:
        self._folder, self._description, self._images = folder, description, images
        self._frames: list[tuple[float, str]] = []
        self._imu: list[FloatArray] = []
        self._truth: list[FloatArray] = []
        (folder / "frames").mkdir()

    def add_frame(self, time: float, depth: FloatArray) -> None:
        """Add a depth frame: z in C [m], 0 where nothing is seen, shape (height, width)."""
        name = f"frames/{len(self._frames):06d}.{self._images}"
        if self._images == "npz":
            np.savez_compressed(self._folder / name, **{DEPTH: depth.astype(np.float32)})  # type: ignore[arg-type]
        else:
            from PIL import Image

            steps = np.clip(np.round(depth / self._description.camera.depth_unit), 0, 65535).astype(np.uint16)
            Image.fromarray(steps).save(self._folder / name)
        self._frames.append((time, name))

    def add_imu(self, samples: FloatArray) -> None:
        """Add inertial samples: time [s], specific force [m/s^2] and angular velocity [rad/s] in B, shape (n, 7)."""
        self._imu.extend(samples)

    def add_truth(self, row: FloatArray) -> None:
        """Add the truth of the last frame, in the order of `TRUTH_COLUMNS`."""
        self._truth.append(row)

    def close(self) -> None:
        """Write the description and the tables."""
        described = self._description.model_dump(mode="json")
        text = "# Sensors of this log; lengths in m, times in s, angles in rad.\n" + yaml.safe_dump(
            described, sort_keys=False
        )
        (self._folder / DESCRIPTION).write_text(text, encoding="utf-8")
        _write(self._folder / FRAMES, FRAME_COLUMNS, ((format(time, _NUMBER), name) for time, name in self._frames))
        _write_numbers(self._folder / IMU_FILES[0], IMU_COLUMNS, self._imu)
        if self._truth:
            _write_numbers(self._folder / TRUTH, TRUTH_COLUMNS, self._truth)


def _write_numbers(path: Path, columns: Sequence[str], rows: Iterable[FloatArray]) -> None:
    _write(path, columns, ([format(value, _NUMBER) for value in row] for row in rows))


def _write(path: Path, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
