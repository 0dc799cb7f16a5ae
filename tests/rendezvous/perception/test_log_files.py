"""What is read of the files of a sensor log on both sides of limits, and what is said of files that are damaged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from safe_inspect.errors import ConfigError
from safe_inspect.missions.sensor_log import (
    TRUTH_COLUMNS,
    CameraDescription,
    SensorDescription,
    read_sensor_log,
)
from safe_inspect.missions.sensor_log_writer import SensorLogWriter
from safe_inspect.rendezvous.experiment import read_target

_CAMERA = CameraDescription(width=10, height=8, fx=12.0, fy=12.0, cx=4.0, cy=3.0, least_range=0.5, largest_range=2.0)


def _write(folder: Path) -> Path:
    writer = SensorLogWriter(folder, SensorDescription(camera=_CAMERA))
    for number in range(3):
        writer.add_frame(0.5 * number, np.full((8, 10), 1.0))
        writer.add_truth(np.eye(len(TRUTH_COLUMNS))[0] * 0.5 * number)
    times = np.array([-0.2, 0.0, 0.1, 0.5, 0.6, 0.9, 1.2])
    writer.add_imu(np.column_stack([times, np.arange(42.0).reshape(7, 6)]))
    writer.close()
    return folder


def test_samples_belong_to_the_frame_that_follows_them(tmp_path: Path) -> None:
    log = read_sensor_log(_write(tmp_path))
    assert len(log) == 3
    assert [samples[:, 0].tolist() for _, samples in log.steps()] == [[], [0.1, 0.5], [0.6, 0.9]]
    assert log.truth is not None
    assert log.truth[:, 0].tolist() == [0.0, 0.5, 1.0]


def test_only_ranges_between_the_limits_are_valid(tmp_path: Path) -> None:
    folder, depth = _write(tmp_path), np.zeros((8, 10))
    rays = _CAMERA.geometry.directions[..., 2]
    depth[3, :] = np.array([0.499, 0.501, 1.999, 2.001, np.nan, -1.0, np.inf, 0.6, 0.7, 0.8]) * rays[3]
    np.savez(folder / "frames" / "000000.npz", depth=depth)
    frame = read_sensor_log(folder).frame(0)
    expected = [False, True, True, False, False, False, False, True, True, True]
    assert frame.valid[3].tolist() == expected
    assert frame.valid.sum() == 5 == len(frame.points)
    assert frame.flags == ()
    np.testing.assert_allclose(np.linalg.norm(frame.points, axis=1), [0.501, 1.999, 0.6, 0.7, 0.8])
    assert frame.depth[3, 0] == 0.0
    np.savez(folder / "frames" / "000000.npz", depth=0.1 * depth)
    assert read_sensor_log(folder).frame(0).flags == ("out_of_view",)


def test_columns_may_be_in_any_order_with_spaces_and_empty_lines(tmp_path: Path) -> None:
    folder = _write(tmp_path)
    before = read_sensor_log(folder)
    rows = [
        "note, file ,time",
        *(f"x, {name} , {time} " for time, name in zip(before.times, before.files, strict=True)),
    ]
    (folder / "frames.csv").write_text("\ufeff" + "\n\n".join(rows) + "\n\n", encoding="utf-8")
    after = read_sensor_log(folder)
    assert after.files == before.files
    np.testing.assert_array_equal(after.times, before.times)


def _text(name: str, text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_text(text)


def _png(mode: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        Image.new(mode, (10, 8)).save(folder / "frames" / "a.png")
        (folder / "frames.csv").write_text("time,file\n0,frames/a.png\n1,frames/a.png\n")
        (folder / "truth.csv").unlink()

    return change


def _named(name: str, data: bytes) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).write_bytes(data)
        (folder / "frames.csv").write_text(f"time,file\n0,{name}\n1,{name}\n")
        (folder / "truth.csv").unlink()

    return change


def _camera(**changes: object) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        described = yaml.safe_load((folder / "sensors.yml").read_text())
        described["camera"] |= changes
        (folder / "sensors.yml").write_text(yaml.safe_dump(described))

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_text("sensors.yml", "- 3\n"), "sensors.yml: it must contain the keys `camera`, `imu` and `start`"),
        (_text("frames.csv", "time,file\n0,frames/000000.npz\n"), "frames.csv: it lists 1 frames; at least two"),
        (_text("frames.csv", ""), "frames.csv:1: the column `time` is missing; the header needs time, file"),
        (_text("frames.csv", "time,file\n0,a,b\n"), "frames.csv:2: 3 values for 2 columns; complete the row"),
        (_text("frames.csv", "time,file\nnan,frames/000000.npz\n"), "frames.csv:2: `time` is 'nan'; give a finite"),
        (_text("frames.csv", "time,file\n0,none.npz\n1,none.npz\n"),
         "frames.csv:2: there is no file 'none.npz'; paths are relative to the log's folder"),
        (_text("frames.csv", "time,file\n1,frames/000000.npz\n1,frames/000001.npz\n"),
         "frames.csv: row 1: the time 1 s does not come after 1 s; sort the rows"),
        (_text("truth.csv", ",".join(TRUTH_COLUMNS) + "\n" + ",".join(["0"] * 15) + "\n"),
         "truth.csv: it has 1 rows for 3 frames; give one row for each, or delete it"),
        (lambda folder: (folder / "frames.csv").write_bytes(b"\xff\xfe"), "frames.csv: it cannot be read ("),
        (_named("frames/a.tif", b""), "a.tif: the file type '.tif' is not supported; give NPZ or 16-bit PNG files"),
        (_named("frames/a.png", b"no image"), "a.png: it cannot be read ("),
        (_png("RGB"), "a.png: its pixels are 'RGB'; write one channel of 16 bits"),
        (lambda folder: np.savez(folder / "frames" / "000000.npz", depth=np.ones(5)),
         "000000.npz: the image has ? x 5 pixels; sensors.yml says 10 x 8; correct one of them"),
        (_camera(least_range="2 m"), "least_range (2.0 m) must be below largest_range (2.0 m)"),
        (_camera(cx=9.51), "camera.cx: 9.51 px is outside of the image, which has 10 pixels along it"),
        (_camera(cy=-0.51), "camera.cy: -0.51 px is outside of the image, which has 8 pixels along it"),
        (_camera(width=7), "camera.width: expected a number of 8 or more"),
        (_camera(orientation=[0, 0, 0, 2]), "orientation is not a unit quaternion [x, y, z, w]: its length is 2"),
    ],
)  # fmt: skip
def test_a_damaged_log_is_refused_with_its_file(tmp_path: Path, change: Callable[[Path], object], message: str) -> None:
    change(_write(tmp_path))
    with pytest.raises(ConfigError) as caught:
        list(read_sensor_log(tmp_path).steps())
    assert message in str(caught.value)


@pytest.mark.parametrize("change", [_png("I;16"), _camera(cx=9.5, cy=-0.5), _camera(cx=-0.5, cy=7.5)])
def test_a_log_at_the_limits_is_read(tmp_path: Path, change: Callable[[Path], object]) -> None:
    change(_write(tmp_path))
    assert list(read_sensor_log(tmp_path).steps())


def test_a_folder_that_is_no_log_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing: there is no such folder; give the folder of a sensor log"):
        read_sensor_log(tmp_path / "nothing")
    with pytest.raises(
        ConfigError, match=r"not a sensor log: there is no sensors.yml; see docs/rendezvous.md for the format"
    ):
        read_sensor_log(tmp_path)
    _write(tmp_path)
    (tmp_path / "imu.csv").unlink()
    with pytest.raises(ConfigError, match=r"imu.csv: it cannot be read \(.*No such file.*\); a sensor log needs it"):
        read_sensor_log(tmp_path)


def test_a_target_is_read_of_a_mesh_or_of_a_key(tmp_path: Path) -> None:
    bracket = Path(__file__).parents[1] / "pieces" / "bracket.obj"
    (tmp_path / "BRACKET.OBJ").write_bytes(bracket.read_bytes())
    (tmp_path / "list.yml").write_text("- 3\n")
    (tmp_path / "target.yml").write_text("seed: -3\ntarget: {functor: BoxTarget}\n")
    assert read_target(tmp_path / "BRACKET.OBJ").swept_radius == read_target(bracket).swept_radius
    assert len(read_target(tmp_path / "target.yml").solid.centre) == 1
    with pytest.raises(
        ConfigError, match=r"list.yml: the file has no key `target`; give a rendezvous experiment, another YAML file"
    ):
        read_target(tmp_path / "list.yml")
