"""What is written, read and estimated of a simulated watch matches the record.

A change that is meant to change it has to update the record:

    RECORD_RENDEZVOUS=1 python -m pytest -n 0 tests/rendezvous/perception/test_recorded_log.py
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from safe_inspect.config.data import configs_root
from safe_inspect.dynamics.quaternion import exp, multiply
from safe_inspect.errors import ConfigError
from safe_inspect.missions.log_estimate import (
    ONLINE_COLUMNS,
    LogEstimate,
    estimate_log,
    estimate_table,
    in_principal_axes,
    measured_rates,
    pick_point,
    summary_of,
    write_estimate,
)
from safe_inspect.missions.sensor_log import CameraDescription, SensorDescription, SensorLog, read_sensor_log
from safe_inspect.missions.sensor_log_writer import SensorLogWriter, record_watch
from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.estimation.estimators import PipelineEstimator
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.plugins import ModelFrontEnd
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse
from safe_inspect.rendezvous.target.model import Target

from ..record import check

RECORD = Path(__file__).with_name("log.json")
_SETTINGS = (
    "sensors.camera={width: 112, height: 85, focal_length: 93.2, largest_range: 3.5 m}", "sensors.imu_ticks=5",
    "chaser.velocity=[1 mm/s, 0 m/s, -1 mm/s]", "chaser.camera_position=[0.1 m, 0.02 m, 0 m]", "mission.tick=10 ms",
    "mission.control_ticks=20", "mission.update_ticks=100",
)  # fmt: skip
_CONFIG = load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment.yml", _SETTINGS).config
_TARGET = _CONFIG.target()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> SensorLog:
    folder, shown = tmp_path_factory.mktemp("watch"), []
    count = record_watch(folder, _CONFIG, 2, 20.0, progress=lambda done, all_: shown.append((done, all_)))
    assert shown == [(done, 21) for done in range(1, 22)]
    assert count == 21
    return read_sensor_log(folder)


def test_a_recorded_watch_matches_the_record(log: SensorLog) -> None:
    described = yaml.safe_load((log.folder / "sensors.yml").read_text())
    steps = [[frame.time, frame.depth, frame.points, len(samples), samples] for frame, samples in log.steps()]
    check(RECORD, "watch", [described, log.times, log.files, log.imu, log.truth, log.T_BC, *log.start, steps])


class _Replayed:
    """A front end that gives known edges."""

    def __init__(self, edges: Sequence[Edge]) -> None:
        self._edges, self._count = edges, -1

    def __call__(self, context: FrontEndContext) -> _Replayed:
        return self

    def step(self, frame: DepthFrame, predicted: Any, rotation: Any) -> list[Edge]:
        self._count += 1
        return [edge for edge in self._edges if edge.second == self._count and edge.first != MODEL]


def _estimated(log: SensorLog, front_end: Any, target: Target | None) -> LogEstimate:
    shown: list[tuple[int, int]] = []
    estimator = PipelineEstimator().model_copy(update={"front_end": front_end})
    found = estimate_log(log, estimator, target, lambda *step: shown.append(step))
    assert shown == [(done, len(log)) for done in range(1, len(log) + 1)]
    return found


@pytest.fixture(scope="module")
def with_model(log: SensorLog) -> LogEstimate:
    return _estimated(log, ModelFrontEnd(), _TARGET)


def _between_frames(edges: Sequence[Edge]) -> list[Edge]:
    """Return the poses between frames that follow each other, of their poses to the model."""
    poses = {edge.second: edge for edge in edges if edge.first == MODEL}
    return [
        replace(poses[k + 1], first=k, pose=inverse(poses[k].pose) @ poses[k + 1].pose, kind="odometry")
        for k in poses
        if k + 1 in poses
    ]


@pytest.mark.parametrize("known", [True, False])
def test_the_estimate_of_a_watch_matches_the_record(
    log: SensorLog, with_model: LogEstimate, known: bool, tmp_path: Path
) -> None:
    found = with_model if known else _estimated(log, _Replayed(_between_frames(with_model.edges)), None)
    summary = summary_of(log, found)
    write_estimate(tmp_path, log, found)
    point = pick_point(log, 12, 56, 42, 0.25)
    in_axes = in_principal_axes(log, found, 12, point)
    without_truth = summary_of(replace(log, truth=None), found)
    assert set(summary) - set(without_truth) == {"errors"}
    check(
        RECORD,
        "known shape" if known else "unknown shape",
        [summary, estimate_table(summary), estimate_table(without_truth), found.online, found.chaser_positions,
         [[edge.first, edge.second, edge.kind, edge.pose] for edge in found.edges], *measured_rates(found), point,
         in_axes, "[" + ", ".join(f"{value:.4f} m" for value in in_axes) + "]", found.attitudes(log.times)],
    )  # fmt: skip
    written = json.loads((tmp_path / "estimate.json").read_text())
    assert written["errors"] == summary["errors"]
    with (tmp_path / "estimate.csv").open() as file:
        header, *rows = csv.reader(file)
    assert tuple(header) == ONLINE_COLUMNS
    values = np.array([[float(value or "nan") for value in row] for row in rows])
    np.testing.assert_allclose(values, found.online, rtol=1e-9)
    edges = np.load(tmp_path / "edges.npz")
    for name in ("first", "second", "pose", "covariance", "inliers", "kind"):
        np.testing.assert_array_equal(edges[name], np.array([getattr(edge, name) for edge in found.edges]), name)
    # Half a turn about an axis counts as an error where the shape is known, and does not where it is not.
    turned = multiply(found.attitudes(log.times), multiply(exp(np.array([np.pi, 0.0, 0.0])), exp(np.full(3, 0.01))))
    error = found.attitude_error(log.times, turned)
    assert np.rad2deg(np.median(error)) == pytest.approx(180.0 if known else np.rad2deg(0.01 * np.sqrt(3.0)), abs=1.1)


@pytest.mark.parametrize(
    ("pixel", "message"),
    [
        ((21, 5, 5), "frame 21, column 5, row 5 is not in the log; it has 21 frames of 112 x 85 pixels"),
        ((-1, 5, 5), "is not in the log"), ((0, 112, 5), "is not in the log"), ((0, 5, 85), "is not in the log"),
        ((0, -1, 5), "is not in the log"), ((0, 5, -1), "is not in the log"),
        ((0, 0, 0), r"000000.npz: column 0, row 0 has no depth; pick a pixel of the target"),
    ],
)  # fmt: skip
def test_a_pixel_that_sees_nothing_gives_no_mating_point(
    log: SensorLog, pixel: tuple[int, int, int], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        pick_point(log, *pixel, 0.1)


def test_a_pixel_among_few_others_gives_no_mating_point(tmp_path: Path) -> None:
    depth = np.zeros((30, 40))
    depth[10, 10:17] = 2.0
    depth[9, 10:17] = 2.1
    writer = SensorLogWriter(
        tmp_path, SensorDescription(camera=CameraDescription(width=40, height=30, fx=40, fy=40, cx=19, cy=15))
    )
    for time in (0.0, 1.0):
        writer.add_frame(time, depth)
    writer.add_imu(np.ones((1, 7)))
    writer.close()
    with pytest.raises(ConfigError, match=r"only 7 pixels around column 13, row 10 see the same surface; pick a pixel"):
        pick_point(read_sensor_log(tmp_path), 0, 13, 10, 0.1)
