"""What ``safe-inspect record-log`` and ``safe-inspect characterise`` do."""

from __future__ import annotations

import argparse
import math
import sys

from safe_inspect.cli.common import output_folder, print_doubts
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.errors import SafeInspectError
from safe_inspect.figures.drawing import save
from safe_inspect.figures.rendezvous.estimate_figure import estimate_figure
from safe_inspect.plugins.registry import registry
from safe_inspect.rendezvous.back_end.isam2 import ISAM2BackEnd
from safe_inspect.rendezvous.characterise.motion import PolhodeCharacteriser
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.plugins import FrontEnd, PipelineEstimator
from safe_inspect.rendezvous.recording.estimation import Estimators, estimate_log
from safe_inspect.rendezvous.recording.mating_point import in_principal_axes, mating_point_text, pick_point
from safe_inspect.rendezvous.recording.plausibility import check_log
from safe_inspect.rendezvous.recording.reader import read_sensor_log
from safe_inspect.rendezvous.recording.record import record_watch
from safe_inspect.rendezvous.recording.report import estimate_table, summary_of, write_estimate
from safe_inspect.rendezvous.recording.target_file import read_target
from safe_inspect.rendezvous.recording.watch import WatchSensors
from safe_inspect.rendezvous.scenario import check_scenario
from safe_inspect.rendezvous.sensors.tof import TimeOfFlightCamera

FIGURE = "estimate.png"


def run_record_log(arguments: argparse.Namespace) -> int:
    """Record the sensors of a simulated watch."""
    experiment = load_rendezvous(arguments.cfg, arguments.overrides)
    print_doubts(check_scenario(experiment))
    config = experiment.config
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
        with output_folder(arguments) as folder:
            assert folder is not None, "--output is required"
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
    print_doubts(check_log(log))
    target = None if arguments.target is None else read_target(arguments.target)
    name = arguments.front_end or ("GicpSubmapFrontEnd" if target is None else "ModelFrontEnd")
    front_end: FrontEnd = registry.get("front_end", name)()
    picked = None if arguments.pick is None else _picked(arguments.pick)
    above = None if picked is None else pick_point(log, *picked)
    bar = EpisodeBar("frames", sys.stderr)
    with output_folder(arguments) as folder:
        bar.show(0, len(log))
        try:
            estimators = Estimators(front_end, ISAM2BackEnd(), PolhodeCharacteriser())
            estimate = estimate_log(log, estimators, target, bar.show)
        finally:
            bar.close()
        if folder is not None:
            write_estimate(folder, log, estimate)
            save(estimate_figure(log, estimate), folder / FIGURE)
    print(estimate_table(summary_of(log, estimate)))
    if picked is not None and above is not None:
        point = in_principal_axes(log, estimate, picked[0], above)
        print(f"mating_point: {mating_point_text(point)}  # in the estimated principal axes")
    if arguments.output is not None:
        print(f"the estimate is in {arguments.output}")
    return 0


def _picked(text: str) -> tuple[int, int, int, float]:
    parts = text.split(",")
    try:
        frame, column, row = (int(part) for part in parts[:3])
        (distance,) = (float(part) for part in parts[3:])
        if not math.isfinite(distance):
            raise ValueError
    except ValueError:
        raise SafeInspectError(
            f"--pick {text!r}: frame, column, row and distance are wanted, such as --pick 12,80,90,0.3"
        ) from None
    return frame, column, row, distance
