"""The command ``safe-inspect validate``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.checked_settings import checked_settings
from safe_inspect.cli.streams import print_doubts
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment, replaced_lists
from safe_inspect.errors import Problem
from safe_inspect.missions.scenario import check_scenario
from safe_inspect.rendezvous.experiment import is_rendezvous, load_rendezvous


def run(arguments: argparse.Namespace) -> int:
    """Check an experiment file without loading Ray.

    All mistakes are reported together, each with file, line and a suggestion.

    Example:
        safe-inspect validate configs/docking/experiment.yml lr=1e-4
    """
    if is_rendezvous(arguments.cfg):
        rendezvous = load_rendezvous(arguments.cfg, arguments.overrides)
        print_doubts(check_scenario(rendezvous))
        config = rendezvous.config
        parts = (config.target, config.tumble, config.planner, config.tracker)
        print(f"{arguments.cfg} is valid: rendezvous, {', '.join(type(part).__name__ for part in parts)}")
        return 0
    experiment = load_experiment(arguments.cfg, arguments.overrides, compute_platform=arguments.compute_platform)
    checked_settings(experiment)
    print_doubts(dict.fromkeys(one for one in replaced_lists(experiment.tree) if _is_in(one, arguments.cfg)))
    agents = ", ".join(f"{agent.name} on {agent.platform}" for agent in experiment.spec.agents)
    print(f"{arguments.cfg} is valid: {experiment.algorithm}, {agents}")
    return 0


def _is_in(problem: Problem, file: str) -> bool:
    """Return whether a problem is in a file of the user; the package's own files replace lists on purpose."""
    location, path = problem.location, Path(file).resolve()
    is_here = location is not None and Path(location.file).resolve() == path
    return is_here and not path.is_relative_to(configs_root().resolve())
