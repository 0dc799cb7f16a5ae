"""What no single value of a sensor log shows: units, clocks and gaps."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from safe_inspect.cli.main import main
from safe_inspect.errors import ConfigError
from safe_inspect.missions.log_checks import check_log
from safe_inspect.missions.sensor_log import (
    TRUTH_COLUMNS,
    CameraDescription,
    SensorDescription,
    read_sensor_log,
)
from safe_inspect.missions.sensor_log_writer import SensorLogWriter
from safe_inspect.types import FloatArray

_CAMERA = CameraDescription(width=40, height=30, fx=40.0, fy=42.0, cx=19.0, cy=15.5)
_END = 10.0

Change = Callable[[FloatArray], FloatArray]


def _samples() -> FloatArray:
    """Return inertial samples of a chaser that turns slowly, with the noise that a description states by default."""
    generator, times = np.random.default_rng(0), 0.02 * np.arange(1, 501)
    turning = 0.02 + 0.01 * np.sin(0.3 * times)[:, None]
    return np.column_stack(
        [times, generator.normal(0.0, 2e-3, (500, 3)), turning + generator.normal(0.0, 1.5e-4, (500, 3))]
    )


def _same(values: FloatArray) -> FloatArray:
    return values


def _log(
    folder: Path, imu: Change = _same, depth: Change = _same, times: Change = _same, truth: Change = _same
) -> Path:
    folder.mkdir()
    writer = SensorLogWriter(folder, SensorDescription(camera=_CAMERA))
    writer.add_imu(imu(_samples()))
    for time in np.arange(0.0, _END + 0.5):
        image = np.zeros((30, 40))
        image[5:25, 8:30] = 1.5
        writer.add_frame(float(times(np.array(time))), depth(image))
        row = np.zeros(len(TRUTH_COLUMNS))
        row[0], row[7], row[11] = time, 1.0, 1.0
        writer.add_truth(truth(row))
    writer.close()
    return folder


def _without(first: float, last: float) -> Change:
    return lambda rows: rows[(rows[:, 0] < first) | (rows[:, 0] > last)]


def _scaled(columns: slice, factor: float) -> Change:
    def change(rows: FloatArray) -> FloatArray:
        rows[..., columns] *= factor
        return rows

    return change


def _shifted(column: int, by: float) -> Change:
    def change(rows: FloatArray) -> FloatArray:
        rows[..., column] += by
        return rows

    return change


def test_a_log_in_order_is_not_doubted(tmp_path: Path) -> None:
    assert check_log(read_sensor_log(_log(tmp_path / "log"))) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"imu": lambda rows: rows[:0]}, "there are no samples; give samples for the time of the frames, 0 to 10 s"),
        ({"imu": _shifted(0, 1e9)}, "its samples are from 1000000000 to 1000000010 s, and the frames from 0 to 10 s"),
        ({"depth": lambda image: 1e3 * image}, "none of 5 frames has a depth in the camera's range .* is 1500 m. NPZ"),
        ({"depth": lambda image: -image}, "none of 5 frames has a depth .* is -1.5 m"),
    ],
)
def test_a_log_that_nothing_can_be_estimated_from_is_refused(
    changes: dict[str, Change], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = _log(tmp_path / "log", **changes)
    with pytest.raises(ConfigError, match=message):
        check_log(read_sensor_log(folder))
    assert main(["characterise", str(folder)]) == 2
    assert capsys.readouterr().err.count("error: ") == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"imu": _without(3.99, 8.01)}, "imu.csv: there is no sample from 3.98 to 8.02 s"),
        ({"imu": _without(5.0, 99.0)}, "imu.csv: there is no sample from 4.98 to 10 s"),
        ({"imu": _without(0.0, 2.01)}, "imu.csv: there is no sample from 0 to 2.02 s"),
        (
            {"imu": _scaled(slice(4, 7), 57.29578)},
            "the median angular velocity is .* rad/s; give radians per second",
        ),
        ({"imu": _scaled(slice(4, 7), 20.0)}, "the angular velocity scatters by .* times what `imu` states"),
        ({"imu": _shifted(3, 9.81)}, r"the median specific force is 9.81 m/s\^2; leave gravity out"),
        ({"imu": _scaled(slice(1, 4), 100.0)}, "the specific force scatters by .* 91 times what `imu` states"),
        ({"truth": _shifted(0, 0.5)}, "truth.csv: its times differ from the frames' by up to 0.5 s"),
        ({"truth": _scaled(slice(8, 12), 2.0)}, "truth.csv: q_WT is not a unit quaternion in row 0"),
    ],
)
def test_what_is_implausible_is_one_warning(changes: dict[str, Change], message: str, tmp_path: Path) -> None:
    (doubt,) = check_log(read_sensor_log(_log(tmp_path / "log", **changes)))
    assert re.search(message, str(doubt)), doubt


@pytest.mark.parametrize(
    ("change", "below", "beyond"),
    [
        (lambda gap: {"imu": _without(3.99, 3.97 + gap)}, 0.19, 0.23),
        (lambda rate: {"imu": _shifted(5, rate)}, 0.95, 1.05),
        (lambda force: {"imu": _shifted(2, -force)}, 0.95, 1.05),
        (lambda factor: {"imu": _scaled(slice(4, 7), factor)}, 9.0, 11.0),
        (lambda factor: {"imu": _scaled(slice(1, 4), factor)}, 10.0, 12.0),
        (lambda late: {"truth": _shifted(0, late)}, 9e-4, 1.1e-3),
        (lambda length: {"truth": _scaled(slice(4, 8), length)}, 1.0009, 1.0011),
        (lambda length: {"truth": _scaled(slice(8, 12), length)}, 0.9991, 0.9989),
    ],
)
def test_a_doubt_begins_at_its_limit(
    change: Callable[[float], dict[str, Change]], below: float, beyond: float, tmp_path: Path
) -> None:
    assert check_log(read_sensor_log(_log(tmp_path / "below", **change(below)))) == []
    assert len(check_log(read_sensor_log(_log(tmp_path / "beyond", **change(beyond))))) == 1


def test_samples_before_and_after_the_frames_are_not_looked_at(tmp_path: Path) -> None:
    def more(rows: FloatArray) -> FloatArray:
        fast = rows + np.array([0.0, 9.0, 0.0, 0.0, 9.0, 0.0, 0.0])
        shifts = (-20.02, -10.01, 0.0, 10.01, 20.02)
        return np.concatenate([(rows if not by else fast) + by * np.eye(7)[0] for by in shifts])

    assert check_log(read_sensor_log(_log(tmp_path / "log", imu=more))) == []


def test_a_log_without_truth_is_not_doubted_for_it(tmp_path: Path) -> None:
    folder = _log(tmp_path / "log")
    (folder / "truth.csv").unlink()
    assert check_log(read_sensor_log(folder)) == []


@pytest.mark.parametrize(("period", "is_doubted"), [(59.9, False), (60.1, True)])
def test_frames_are_a_minute_apart_at_most(period: float, is_doubted: bool, tmp_path: Path) -> None:
    slow = {"times": lambda time: period * time, "imu": _scaled(slice(0, 1), period)}
    doubts = check_log(read_sensor_log(_log(tmp_path / "log", **slow)))
    assert any("the frames are" in str(doubt) for doubt in doubts) is is_doubted


def test_times_in_milliseconds_are_named(tmp_path: Path) -> None:
    thousandfold = {"times": lambda time: 1e3 * time * 61.0, "imu": _scaled(slice(0, 1), 61e3)}
    doubts = check_log(read_sensor_log(_log(tmp_path / "log", **thousandfold)))
    assert any(
        "frames.csv: the frames are 6.1e+04 s apart; give the times in seconds" in str(doubt) for doubt in doubts
    )


def test_a_principal_point_outside_of_the_image_is_refused_with_its_line(tmp_path: Path) -> None:
    folder = _log(tmp_path / "log")
    described = yaml.safe_load((folder / "sensors.yml").read_text())
    described["camera"] |= {"cx": 500.0, "cy": -40.0}
    (folder / "sensors.yml").write_text(yaml.safe_dump(described, sort_keys=False))
    with pytest.raises(ConfigError) as caught:
        read_sensor_log(folder)
    assert "sensors.yml:6 camera.cx: 500 px is outside of the image, which has 40 pixels along it" in str(caught.value)
    assert "sensors.yml:7 camera.cy: -40 px is outside" in str(caught.value)


def test_the_command_warns_and_continues(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = _log(tmp_path / "log", imu=_without(3.99, 8.01))
    assert main(["characterise", str(folder)]) == 2  # a flat image shows no motion
    err = capsys.readouterr().err
    assert "warning: " in err
    assert "there is no sample from 3.98 to 8.02 s" in err
    assert "the motion of the target could not be determined" in err


def test_what_works_in_simulations_only_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(_log(tmp_path / "log"))
    assert main(["characterise", folder, "--front-end", "MeasuredPoses"]) == 2
    assert "error: MeasuredPoses works in simulations only" in capsys.readouterr().err
