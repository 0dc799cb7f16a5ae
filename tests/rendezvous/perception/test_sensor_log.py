from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError
from safe_inspect.missions.log_estimate import pick_point
from safe_inspect.missions.sensor_log import (
    FRAME_COLUMNS,
    IMU_COLUMNS,
    CameraDescription,
    SensorDescription,
    read_sensor_log,
)
from safe_inspect.missions.sensor_log_writer import SensorLogWriter
from safe_inspect.rendezvous.experiment import read_target
from safe_inspect.rendezvous.target.boxes import EnvisatTarget

_EXPERIMENT = str(configs_root() / "tumbling-rendezvous" / "experiment.yml")
_CAMERA = CameraDescription(width=40, height=30, fx=40.0, fy=42.0, cx=19.0, cy=15.5)


def _depth(number: int) -> np.ndarray:
    depth = np.zeros((30, 40))
    depth[5:25, 8:30] = 1.5 + 0.001 * number + 0.01 * np.arange(22)
    return depth


def _write(folder: Path, images: str = "npz", count: int = 3) -> Path:
    folder.mkdir()
    writer = SensorLogWriter(folder, SensorDescription(camera=_CAMERA), images)  # type: ignore[arg-type]
    for number in range(count):
        times = 0.5 * number - 0.5 + 0.1 * np.arange(1, 6)
        writer.add_imu(np.column_stack([times, np.full((5, 6), 0.01 * number)]))
        writer.add_frame(0.5 * number, _depth(number))
    writer.close()
    return folder


@pytest.mark.parametrize(("images", "tolerance"), [("npz", 1e-6), ("png", 5.1e-4)])
def test_what_is_written_is_read_again(tmp_path: Path, images: str, tolerance: float) -> None:
    log = read_sensor_log(_write(tmp_path / "log", images))
    steps = list(log.steps())
    assert [frame.time for frame, _ in steps] == [0.0, 0.5, 1.0]
    # The samples before the first frame are left out.
    assert [len(samples) for _, samples in steps] == [0, 5, 5]
    for number, (frame, _) in enumerate(steps):
        np.testing.assert_allclose(frame.depth, _depth(number), atol=tolerance)
        assert len(frame.points) == frame.valid.sum() == 20 * 22
    # A point of the pixel of the principal point lies on the optical axis.
    np.testing.assert_allclose(_CAMERA.geometry.directions[15:17, 19].sum(axis=0)[:2], [0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(log.T_BC[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)


def test_parquet_says_the_same_as_csv(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = _write(tmp_path / "log")
    imu = read_sensor_log(folder).imu
    pq.write_table(pa.table({name: imu[:, k] for k, name in enumerate(IMU_COLUMNS)}), folder / "imu.parquet")
    with pytest.raises(ConfigError, match="exactly one"):
        read_sensor_log(folder)
    (folder / "imu.csv").unlink()
    np.testing.assert_array_equal(read_sensor_log(folder).imu, imu)


def _edit(name: str, before: str, after: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert before in text
        (folder / name).write_text(text.replace(before, after))

    return change


def _remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def _replace_frame(folder: Path) -> None:
    np.savez(folder / "frames" / "000001.npz", depths=np.ones((30, 40)))


def _damage_frame(folder: Path) -> None:
    (folder / "frames" / "000001.npz").write_bytes(b"PK no archive")


def _small_frame(folder: Path) -> None:
    np.savez(folder / "frames" / "000001.npz", depth=np.ones((10, 12)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_remove("sensors.yml"), "there is no sensors.yml"),
        (_remove("frames.csv"), r"frames.csv: it cannot be read"),
        (_remove("imu.csv"), "exactly one"),
        (_edit("sensors.yml", "fx: 40.0", "fx: -3"), r"sensors.yml:\d+ camera.fx"),
        (_edit("sensors.yml", "fx: 40.0", "fxx: 40"), "did you mean `fx`?"),
        (_edit("sensors.yml", "- 0.5\n", "- 0.9\n"), "unit quaternion"),
        (_edit("frames.csv", "time,file", "seconds,file"), r"frames.csv:1: the column `time` is missing"),
        (_edit("frames.csv", "000001.npz", "000009.npz"), r"frames.csv:3: there is no file 'frames/000009.npz'"),
        (_edit("frames.csv", "0.5,", "-0.5,"), "does not come after"),
        (_edit("imu.csv", "0.01,0.01,0.01\n", "0.01,0.01,x\n"), r"imu.csv:\d+: `angular_velocity_z` is 'x'"),
        (_edit("imu.csv", "0.01,0.01,0.01\n", "0.01,0.01\n"), r"imu.csv:\d+: 6 values for 7 columns"),
        (_replace_frame, "000001.npz: it has no array `depth`; it has depths"),
        (_damage_frame, "000001.npz: it cannot be read"),
        (_small_frame, "000001.npz: the image has 12 x 10 pixels; sensors.yml says 40 x 30"),
    ],
)
def test_a_mistake_is_one_message_that_says_where(
    tmp_path: Path, change: Callable[[Path], None], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = _write(tmp_path / "log")
    change(folder)
    with pytest.raises(ConfigError, match=message):
        list(read_sensor_log(folder).steps())


def test_the_command_prints_a_mistake_without_a_traceback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = _write(tmp_path / "log")
    assert main(["characterise", str(tmp_path / "nowhere")]) == 2
    assert "there is no such folder" in capsys.readouterr().err
    assert main(["characterise", str(folder), "--front-end", "GicpFrontEnd"]) == 2
    assert "GicpSubmapFrontEnd" in capsys.readouterr().err
    assert main(["characterise", str(folder)]) == 2
    assert "the motion of the target could not be determined" in capsys.readouterr().err


def test_a_point_is_picked_above_the_surface(tmp_path: Path) -> None:
    folder = tmp_path / "log"
    folder.mkdir()
    writer = SensorLogWriter(folder, SensorDescription(camera=_CAMERA))
    for number in range(2):
        writer.add_frame(float(number), np.full((30, 40), 2.0))
    writer.add_imu(np.column_stack([[0.5, 1.0], np.zeros((2, 6))]))
    writer.close()
    log = read_sensor_log(folder)
    # A plane 2 m in front of a camera that looks along x of B: the point is nearer by the distance.
    np.testing.assert_allclose(pick_point(log, 0, 19, 15, 0.3), [1.7, 0.0, -0.5 * 2.0 / 42.0], atol=1e-6)
    with pytest.raises(ConfigError, match="is not in the log"):
        pick_point(log, 5, 19, 15, 0.3)


def test_the_target_of_an_experiment_is_read(tmp_path: Path) -> None:
    expected = EnvisatTarget()()
    np.testing.assert_array_equal(read_target(_EXPERIMENT).solid.centre, expected.solid.centre)
    (tmp_path / "a.yml").write_text("target: {functor: EnvisatTarge}\n")
    with pytest.raises(ConfigError, match=r"a.yml:1 target.*EnvisatTarget"):
        read_target(tmp_path / "a.yml")
    (tmp_path / "b.yml").write_text("shape: 3\n")
    with pytest.raises(ConfigError, match="no key `target`"):
        read_target(tmp_path / "b.yml")


@pytest.mark.slow
def test_a_recorded_watch_is_characterised_twice_to_the_byte(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log"
    assert main(["record-log", _EXPERIMENT, "--seconds", "40", "--period", "1", "--output", str(log)]) == 0
    assert "41 frames" in capsys.readouterr().out
    described = yaml.safe_load((log / "sensors.yml").read_text())
    assert described["camera"]["width"] == 224
    assert (log / "frames.csv").read_text().startswith(",".join(FRAME_COLUMNS))
    for name in ("first", "second"):
        command = ["characterise", str(log), "--target", _EXPERIMENT, "--output", str(tmp_path / name)]
        assert main(command) == 0
        assert "errors against the truth" in capsys.readouterr().out
    import json

    errors = json.loads((tmp_path / "first" / "estimate.json").read_text())["errors"]
    assert errors["attitude_at_the_end_deg"] < 2.0
    assert errors["rate_at_the_end_deg_per_s"] < 0.3
    for file in ("estimate.json", "estimate.csv", "edges.npz"):
        assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "second" / file).read_bytes()
    assert (tmp_path / "first" / "estimate.png").is_file()


def test_a_changed_byte_of_a_frame_is_read_or_refused_in_one_message(tmp_path: Path) -> None:
    """Among others, it makes the archive one that is encrypted, or of an unknown compression."""
    log = read_sensor_log(_write(tmp_path / "log"))
    file = tmp_path / "log" / "frames" / "000001.npz"
    np.savez_compressed(file, depth=np.round(np.random.default_rng(0).random((30, 40)), 2))
    whole, refused = file.read_bytes(), list[str]()
    for place in (*range(80), *range(80, len(whole) - 120, 41), *range(len(whole) - 120, len(whole))):
        for flip in (0x01, 0xFF):
            file.write_bytes(whole[:place] + bytes([whole[place] ^ flip]) + whole[place + 1 :])
            try:
                log.frame(1)
            except ConfigError as error:
                refused.append(str(error))
    assert len(refused) > 100
    assert all("000001.npz" in message for message in refused)
