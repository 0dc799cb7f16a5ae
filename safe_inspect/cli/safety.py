"""The commands ``safe-inspect safety`` and ``safe-inspect acceptance``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from safe_inspect.cli.arguments import positive, seed
from safe_inspect.errors import ConfigError

if TYPE_CHECKING:
    from safe_inspect.config.experiment import Experiment


def add_safety_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the safety report, beside those that name an experiment."""
    parser.add_argument("--steps", type=positive, default=1_000_000, help="filtered steps (default: 1000000)")
    parser.add_argument("--num-envs", type=positive, default=1024, help="environments at a time (default: 1024)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of initial states and adversaries (default: 0)")
    parser.add_argument("--off", action="store_true", help="leave the filter as configured instead of enabling it")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the worst episode's safety quantities")


def add_acceptance_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the acceptance rates, beside those that name an experiment."""
    parser.add_argument("--draws", type=positive, default=100_000, help="initial states (default: 100000)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the draws (default: 0)")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the drawn and the accepted states")


def run_safety(arguments: argparse.Namespace) -> int:
    """Print the safety report; return 1 when a constraint was violated."""
    from safe_inspect.evaluation.safety.report import safety_report
    from safe_inspect.figures.drawing import save
    from safe_inspect.figures.safety_figures import safety_figure

    experiment = _load(arguments, enable=not arguments.off)

    def tell(done: int, asked: int) -> None:
        print(f"\r{done:,} of {asked:,} steps", end="" if done < asked else "\n", file=sys.stderr)

    report = safety_report(
        experiment.spec,
        arguments.steps,
        arguments.num_envs,
        arguments.seed,
        progress=tell if sys.stderr.isatty() else None,
    )
    print(report)
    if arguments.plot is not None:
        save(safety_figure(report), arguments.plot)
    return 1 if report.violations else 0


def run_acceptance(arguments: argparse.Namespace) -> int:
    """Print the acceptance rates."""
    from safe_inspect.evaluation.safety.acceptance import acceptance
    from safe_inspect.figures.drawing import save
    from safe_inspect.figures.safety_figures import acceptance_figure

    found = acceptance(_load(arguments, enable=False).spec, arguments.draws, arguments.seed)
    print(found)
    if arguments.plot is not None:
        save(acceptance_figure(found), arguments.plot)
    return 0


def _load(arguments: argparse.Namespace, *, enable: bool) -> Experiment:
    """Load the experiment, with its safety glue enabled when that is asked for."""
    from safe_inspect.config.experiment import load_experiment
    from safe_inspect.rta.base import SafetyGlue

    def load(overrides: list[str]) -> Experiment:
        return load_experiment(arguments.cfg, overrides, compute_platform=arguments.compute_platform)

    experiment = load(arguments.overrides)
    if not enable:
        return experiment
    glues = experiment.config.agent_config[0].config.config.glues
    for index, glue in enumerate(glues):
        if isinstance(glue, SafetyGlue):
            where = f"agent_config.0.config.config.glues.{index}.config.enabled"
            return experiment if glue.enabled else load([*arguments.overrides, f"{where}=True"])
    raise ConfigError(f"{arguments.cfg}: no glue of the agent is a safety glue; wrap the controllers in one")
