"""The command ``safe-inspect baseline``: open-loop plans that are made with perfect knowledge of each episode."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import add_option, add_overrides, positive, seed
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.environments.registration import load_spec
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.baselines import OPTIMISER, baseline_table, complete, empty_record
from safe_inspect.evaluation.optimiser import EFFORTS

#: The default task.
_DEFAULT_CFG = "safe_inspect/TranslationalInspectionSeed-v0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``baseline``."""
    parser.add_argument("kind", metavar="BASELINE", help="optimiser: open-loop plans made with perfect knowledge")
    add_option(parser, "--cfg", "FILE", "experiment file, or id of a task", default=_DEFAULT_CFG)
    add_overrides(parser)
    add_option(parser, "--episodes", "N", "number of episodes", positive, 100)
    add_option(parser, "--seed", "N", "seed of the episodes", seed, 0)
    parser.add_argument(
        "--effort", choices=tuple(EFFORTS), default="normal", help="how long the optimiser searches (default: normal)"
    )
    add_option(parser, "--output", "FILE", "write the result to this file, or continue it", Path)
    parser.add_argument("--force", action="store_true", help="replace a file of another task, seed or effort")


def run(arguments: argparse.Namespace) -> int:
    """Optimise open-loop plans.

    They give the minimum delta-v of each episode with full knowledge of it; `evaluate` runs policies without.

    Example:
        safe-inspect baseline optimiser --episodes 100 --output optimum.json
    """
    if arguments.kind not in (OPTIMISER, "optimizer"):
        raise SafeInspectError(
            f"there is no baseline {arguments.kind!r}; write `{OPTIMISER}`, or run a policy by `safe-inspect evaluate`"
        )
    spec = load_spec(arguments.cfg, arguments.overrides)
    asked = empty_record(spec, arguments.seed, arguments.effort, str(arguments.cfg), arguments.overrides)
    try:
        with EpisodeBar(OPTIMISER) as bar:
            record = complete(
                spec, asked, arguments.episodes, path=arguments.output, force=arguments.force, progress=bar.show
            )
    except KeyboardInterrupt as stop:
        if arguments.output is not None:
            stop.add_note("the same command continues from there")
        raise
    print(baseline_table(record))
    if arguments.output is not None:
        print(f"the episodes are in {arguments.output}")
    return 0
