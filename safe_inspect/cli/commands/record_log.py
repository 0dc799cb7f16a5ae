"""The command ``safe-inspect record-log``."""

from __future__ import annotations

import argparse

from safe_inspect.cli.arguments import (
    add_experiment_arguments,
    add_option,
    add_output_folder,
    natural,
    output_folder,
    positive_number,
)
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.streams import print_doubts, print_loading
from safe_inspect.errors import SafeInspectError
from safe_inspect.missions.scenario import check_scenario
from safe_inspect.missions.sensor_log_writer import record_watch
from safe_inspect.rendezvous.experiment import load_rendezvous


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``record-log``."""
    add_experiment_arguments(parser, platform=False)
    add_output_folder(parser, "the log", required=True)
    add_option(parser, "--seconds", "SECONDS", "length of the log", positive_number, 120.0)
    add_option(parser, "--period", "SECONDS", "time between two frames", positive_number, 1.0)
    add_option(parser, "--mission", "N", "draw the tumble of mission N", natural, 0)


def run(arguments: argparse.Namespace) -> int:
    """Record depth images and inertial samples of a simulated tumbling target.

    The log is the input of `characterise`; docs/rendezvous.md describes its format.

    Example:
        safe-inspect record-log configs/tumbling-rendezvous/experiment.yml --output output/log --seconds 30
    """
    print_loading()
    experiment = load_rendezvous(arguments.cfg, arguments.overrides)
    print_doubts(check_scenario(experiment))
    config = experiment.config
    steps = arguments.period / config.mission.step
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise SafeInspectError(
            f"--period {arguments.period:g} is not a multiple of the control step, {config.mission.step:g} s; round it"
        )
    sensors = config.sensors.model_copy(update={"frame_period": arguments.period})
    config = config.model_copy(update={"sensors": sensors})
    with EpisodeBar("frames") as bar, output_folder(arguments) as folder:
        assert folder is not None, "--output is required"
        count = record_watch(folder, config, arguments.mission, arguments.seconds, bar.show)
    print(f"{count} frames are in {arguments.output}")
    return 0
