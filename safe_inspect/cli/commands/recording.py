"""What ``safe-inspect record-log`` and ``safe-inspect characterise`` do."""

from __future__ import annotations

import argparse
import sys

from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.errors import SafeInspectError
from safe_inspect.figures.drawing import save
from safe_inspect.figures.rendezvous.estimate_figure import estimate_figure
from safe_inspect.outputs import new_folder
from safe_inspect.plugins.registry import registry
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.plugins import (
    FrontEnd,
    ISAM2BackEnd,
    PipelineEstimator,
    PolhodeCharacteriser,
    TimeOfFlightCamera,
)
from safe_inspect.rendezvous.recording.estimation import Estimators, LogEstimate, estimate_log
from safe_inspect.rendezvous.recording.mating_point import in_principal_axes, mating_point_text, pick_point
from safe_inspect.rendezvous.recording.reader import SensorLog, read_sensor_log
from safe_inspect.rendezvous.recording.record import record_watch
from safe_inspect.rendezvous.recording.report import estimate_table, summary_of, write_estimate
from safe_inspect.rendezvous.recording.target_file import read_target
from safe_inspect.rendezvous.recording.watch import WatchSensors

FIGURE = "estimate.png"


def run_record_log(arguments: argparse.Namespace) -> int:
    """Record the sensors of a simulated watch."""
    config = load_rendezvous(arguments.cfg, arguments.overrides).config
    steps = arguments.period / config.mission.step
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise SafeInspectError(
            f"--period {arguments.period:g} is no multiple of the step of control, {config.mission.step:g} s; round it"
        )
    sensors = WatchSensors(TimeOfFlightCamera(), period=arguments.period)
    if isinstance(config.estimator, PipelineEstimator):
        own = config.estimator
        sensors = WatchSensors(own.camera, own.imu, own.imu_ticks, arguments.period)
    bar = EpisodeBar("frames", sys.stderr)
    try:
        with new_folder(arguments.output) as folder:
            count = record_watch(
                folder, config, sensors, arguments.mission, arguments.seconds, arguments.images, bar.show
            )
    finally:
        bar.close()
    print(f"{count} frames are in {arguments.output}")
    return 0


def run_characterise(arguments: argparse.Namespace) -> int:
    """Estimate how a target tumbles, and write and print what was found."""
    log = read_sensor_log(arguments.folder)
    target = None if arguments.target is None else read_target(arguments.target)
    name = arguments.front_end or ("GicpSubmapFrontEnd" if target is None else "ModelFrontEnd")
    front_end: FrontEnd = registry.get("front_end", name)()
    picked = None if arguments.pick is None else _picked(arguments.pick)
    above = None if picked is None else pick_point(log, *picked)
    bar = EpisodeBar("frames", sys.stderr)
    bar.show(0, len(log))
    try:
        estimate = estimate_log(log, Estimators(front_end, ISAM2BackEnd(), PolhodeCharacteriser()), target, bar.show)
    finally:
        bar.close()
    if arguments.output is not None:
        _write(arguments, log, estimate)
    print(estimate_table(summary_of(log, estimate)))
    if picked is not None and above is not None:
        point = in_principal_axes(log, estimate, picked[0], above)
        print(f"mating_point: {mating_point_text(point)}  # in the estimated principal axes")
    if arguments.output is not None:
        print(f"the estimate is in {arguments.output}")
    return 0


def _write(arguments: argparse.Namespace, log: SensorLog, estimate: LogEstimate) -> None:
    with new_folder(arguments.output) as folder:
        write_estimate(folder, log, estimate)
        save(estimate_figure(log, estimate), folder / FIGURE)


def _picked(text: str) -> tuple[int, int, int, float]:
    parts = text.split(",")
    try:
        frame, column, row = (int(part) for part in parts[:3])
        (distance,) = (float(part) for part in parts[3:])
    except ValueError:
        raise SafeInspectError(
            f"--pick {text!r}: frame, column, row and distance are wanted, such as --pick 12,80,90,0.3"
        ) from None
    return frame, column, row, distance
