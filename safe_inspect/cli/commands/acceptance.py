"""The command ``safe-inspect acceptance``."""

from __future__ import annotations

import argparse

from safe_inspect.cli.arguments import add_experiment_arguments, add_option, positive, seed
from safe_inspect.cli.streams import print_error
from safe_inspect.config.experiment import load_experiment
from safe_inspect.evaluation.safety_report import acceptance


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``acceptance``."""
    add_experiment_arguments(parser)
    add_option(parser, "--draws", "N", "number of initial states", positive, 100_000)
    add_option(parser, "--seed", "N", "seed of the draws", seed, 0)


def run(arguments: argparse.Namespace) -> int:
    """Print the share of random initial states that is safe.

    It also prints which constraint refuses the others, which of them `alone`, and how many have no backup plan
    (`recoverable`).

    Example:
        safe-inspect acceptance configs/translational-inspection/experiment.yml
    """
    spec = load_experiment(arguments.cfg, arguments.overrides, compute_platform=arguments.compute_platform).spec
    found = acceptance(spec, arguments.draws, arguments.seed)
    print(found)
    disabled = [glue for agent in spec.agents for glue in agent.action_glues if not getattr(glue, "enabled", True)]
    if disabled and (spec.team_safety is None or not spec.team_safety.enabled):
        name = type(disabled[0]).registered_name
        print_error(
            f"note: only the sampler's constraints are checked, because the filter is off; set "
            f"{name}.config.enabled=true to reject initial states that the filter cannot keep safe too"
        )
    return 0
