"""Accuracy of the front ends of a rendezvous on simulated watches of 120 s, and their time for a frame.

python benchmarks/rendezvous_perception.py [--front-end ModelFrontEnd] [--profile nominal] [--seeds 20] [--period 1]

Printed for each seed, then as medians and 95th percentiles over all seeds:
    pair      error of the rotation of edges between two frames [degrees]
    pose      error of the rotation of poses to the model [degrees]
    drift     error of the attitude since the first frame, at the end, from the edges alone [degrees], by least squares
    NEES      squared errors over their covariances, for each of six degrees of freedom: 1 where these are right
    ms        processor time of a frame, without the first one
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from safe_inspect.geometry.pointing import R_BC
from safe_inspect.missions.sensor_log_writer import WatchedFrame, watch
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import TimeOfFlightCamera
from safe_inspect.rendezvous.experiment import RendezvousConfig, SensorsConfig
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.plugins import FrontEnd, GicpSubmapFrontEnd, ModelFrontEnd
from safe_inspect.rendezvous.poses import MODEL, Edge, difference, inverse, pose, rotation_exp
from safe_inspect.types import FloatArray

_FRONT_ENDS: dict[str, FrontEnd] = {
    "ModelFrontEnd": ModelFrontEnd(),
    "GicpSubmapFrontEnd": GicpSubmapFrontEnd(),
    "GicpSubmapFrontEnd-8": GicpSubmapFrontEnd(submap=8),
}
_TUMBLES: dict[str, dict[str, Any]] = {
    "tri_low": {"functor": "TriAxialTumble"},
    "tri_high": {"functor": "TriAxialTumble", "config": {"direction": [0.2, 0.4, 0.9]}},
    "near_flat": {"functor": "TriAxialTumble", "config": {"direction": [0.02, 0.02, 1.0]}},
    "random": {"functor": "RandomTumble"},
}


def main() -> None:
    """Print the figures of one front end."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--front-end", choices=_FRONT_ENDS, default="ModelFrontEnd")
    parser.add_argument("--profile", choices=("ideal", "clean", "nominal", "harsh"), default="nominal")
    parser.add_argument("--tumble", choices=_TUMBLES, default="tri_low")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--period", type=float, default=1.0, help="time between two frames [s]")
    arguments = parser.parse_args()
    rows = []
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        row = _measure(_FRONT_ENDS[arguments.front_end], arguments, seed)
        rows.append(row)
        print(seed, " ".join(f"{name} {value:.3g}" for name, value in row.items()), flush=True)
    print(f"{arguments.front_end} {arguments.profile} {arguments.tumble}: {len(rows)} seeds")
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        values = values[np.isfinite(values)]
        if len(values):
            print(f"  {name:22} median {np.median(values):8.3g}  95th percentile {np.percentile(values, 95):8.3g}")


def _measure(front_end: FrontEnd, arguments: argparse.Namespace, seed: int) -> dict[str, float]:
    camera = TimeOfFlightCamera(profile=arguments.profile)
    sensors = SensorsConfig(camera=camera, frame_period=arguments.period)
    config = RendezvousConfig.model_validate({"tumble": _TUMBLES[arguments.tumble], "sensors": sensors})
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    streams = Streams(config.seed, np.array([seed]), np.zeros(1, np.int64))
    run = front_end(FrontEndContext(camera.geometry, mount, config.target(), streams))
    truth: list[FloatArray] = []
    edges: list[Edge] = []
    spent: list[float] = []
    for seen in watch(config, seed, arguments.seconds):
        truth.append(seen.T_MB)
        begin = time.process_time()
        edges += run.step(seen.frame, None, gyro_turn(seen))
        spent.append(time.process_time() - begin)
    return _figures(edges, truth) | {"ms": 1e3 * float(np.mean(spent[1:])), "ms first": 1e3 * spent[0]}


def gyro_turn(seen: WatchedFrame) -> FloatArray:
    """Return R_B'B of the gyro since the last frame."""
    turn, last = np.eye(3), seen.frame.time - len(seen.imu) * 0.016
    for row in seen.imu:
        turn = turn @ rotation_exp(row[4:7] * (row[0] - last))
        last = row[0]
    return turn


def _figures(edges: list[Edge], truth: list[FloatArray]) -> dict[str, float]:
    figures: dict[str, float] = {}
    for name, chosen in (
        ("pair", [edge for edge in edges if edge.first != MODEL]),
        ("pose", [edge for edge in edges if edge.first == MODEL]),
    ):
        errors = [difference(_true(edge, truth), edge.pose) for edge in chosen]
        angles = np.rad2deg([np.linalg.norm(error[:3]) for error in errors])
        nees = [e @ np.linalg.solve(edge.covariance, e) / 6.0 for e, edge in zip(errors, chosen, strict=True)]
        figures[f"{name} number"] = len(chosen)
        for label, values in (("median", angles), ("NEES", np.array(nees))):
            figures[f"{name} {label}"] = float(np.median(values)) if len(values) else np.nan
        figures[f"{name} p95"] = float(np.percentile(angles, 95)) if len(angles) else np.nan
        figures[f"{name} NEES mean"] = float(np.mean(nees)) if nees else np.nan
        figures[f"{name} share within 5"] = float((angles < 5.0).mean()) if len(angles) else np.nan
    numbers = [edge.second for edge in edges if edge.first == MODEL]
    figures["first model pose"] = float(numbers[0]) if numbers else np.nan
    figures["frames without"] = len(truth) - 1 - len({edge.second for edge in edges})
    last = truth[-1]
    for name, chosen in (
        ("drift", edges),
        ("drift without loops", [edge for edge in edges if edge.kind != "loop"]),
    ):
        found = _solve(chosen, len(truth))
        figures[name] = np.nan if found is None else _angle(inverse(truth[0]) @ last, found)
    return figures


def _true(edge: Edge, truth: list[FloatArray]) -> FloatArray:
    second = truth[edge.second]
    return second if edge.first == MODEL else inverse(truth[edge.first]) @ second


def _angle(expected: FloatArray, found: FloatArray) -> float:
    return float(np.rad2deg(np.linalg.norm(difference(expected, found)[:3])))


def _solve(edges: list[Edge], count: int) -> FloatArray | None:
    """Return the pose of the last frame in that of the first, by least squares over the edges."""
    gtsam = require("gtsam")
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.addPriorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6))
    values.insert(0, gtsam.Pose3())
    model = count
    for edge in edges:
        first = model if edge.first == MODEL else edge.first
        relative = gtsam.Pose3(edge.pose)
        if not values.exists(first):
            if not values.exists(edge.second):
                values.insert(edge.second, gtsam.Pose3())
            values.insert(first, values.atPose3(edge.second).compose(relative.inverse()))
        if not values.exists(edge.second):
            values.insert(edge.second, values.atPose3(first).compose(relative))
        noise = gtsam.noiseModel.Gaussian.Covariance(edge.covariance)
        robust = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.345), noise)
        graph.add(gtsam.BetweenFactorPose3(first, edge.second, relative, robust))
    frames = [edge.second for edge in edges]
    if not frames or max(frames) < count - 3:
        return None
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    newest = max(frames)
    return np.asarray(found.atPose3(newest).matrix()) if newest == count - 1 else None


if __name__ == "__main__":
    main()
