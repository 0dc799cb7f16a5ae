"""The command ``safe-inspect safety``."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from safe_inspect.cli.arguments import add_experiment_arguments, add_option, positive, seed
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.streams import print_error
from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.safety_report import safety_report
from safe_inspect.figures.drawing import FIGURE_ENDINGS, require_matplotlib, save
from safe_inspect.figures.trajectory_figure import safety_figure
from safe_inspect.outputs import check_ending
from safe_inspect.rta.audit import Audit, audit
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.rta.inspection import RTAGlueCWHInspection1v1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``safety``."""
    add_experiment_arguments(parser)
    add_option(parser, "--steps", "N", "number of filtered steps", positive, 1_000_000)
    add_option(parser, "--num-envs", "N", "number of environments", positive, 1024)
    add_option(parser, "--seed", "N", "seed of initial states and adversaries", seed, 0)
    parser.add_argument("--off", action="store_true", help="switch the filter off; otherwise it is switched on")
    add_option(parser, "--plot", "FILE", "plot the safety quantities of the worst episode", Path)
    audits = "start from states near the limits, with this filter and N filters of random parameters and constraints"
    add_option(parser, "--audit", "N", audits, positive)


def run(arguments: argparse.Namespace) -> int:
    """Run adversaries against the safety filter and count violations.

    Constraints are checked at the steps and at moments between them; exits with 1 if one was violated.

    Example:
        safe-inspect safety configs/docking/experiment.yml --steps 20000
    """
    if arguments.audit is not None:
        return _run_audit(arguments)
    if arguments.plot is not None:
        check_ending(arguments.plot, FIGURE_ENDINGS, "figure", "--plot")
        require_matplotlib()
    experiment = _load(arguments, enabled=not arguments.off)
    with EpisodeBar("steps") as bar:
        bar.show(0, arguments.steps)
        report = safety_report(experiment.spec, arguments.steps, arguments.num_envs, arguments.seed, progress=bar.show)
    print(report)
    if arguments.plot is not None:
        save(safety_figure(report), arguments.plot)
    return 1 if report.violations else 0


def _run_audit(arguments: argparse.Namespace) -> int:
    """Print the audit; return 1 if a constraint was violated or a step had no plan."""
    experiment = _load(arguments, enabled=True)
    glue = next(glue for glue in experiment.spec.agents[0].action_glues if isinstance(glue, SafetyGlue))
    if not isinstance(glue, RTAGlueCWHInspection1v1) or glue.method != "backup":
        raise ConfigError(f"{arguments.cfg}: the audit supports only RTAGlueCWHInspection1v1 with the method 'backup'")

    def show(found: Audit) -> None:
        line = f"{found.settings:,} of {arguments.audit + 1:,} settings, {found.steps:,} steps"
        print_error(f"{line}, {found.infeasible:,} without a plan, {found.violations:,} violations")

    report = audit(arguments.audit, seed=arguments.seed, first=glue.backup_filter, progress=show)
    print(report)
    others = [name for name in glue.kept if name not in report.least]
    if others:
        print_error(
            f"note: {' and '.join(others)} not audited, because the audit only has independent definitions of the "
            "built-in constraints; run `safe-inspect safety` without --audit to test it"
        )
    return 1 if report.violations or report.infeasible else 0


def _load(arguments: argparse.Namespace, *, enabled: bool) -> Experiment:
    """Load the experiment, with its safety glue enabled or disabled."""
    load = partial(load_experiment, arguments.cfg, compute_platform=arguments.compute_platform)
    experiment = load(arguments.overrides)
    team = experiment.spec.team_safety
    if team is not None and team.enabled:
        raise ConfigError(
            f"{arguments.cfg}: its safety filter is that of the team, and this command tests the filter of one deputy; "
            "give an experiment of one deputy, or look at the team's constraints with `evaluate` and `draw`"
        )
    glues = experiment.config.agent_config[0].config.config.glues
    for index, glue in enumerate(glues):
        if isinstance(glue, SafetyGlue):
            where = f"agent_config.0.config.config.glues.{index}.config.enabled"
            return experiment if glue.enabled == enabled else load([*arguments.overrides, f"{where}={enabled}"])
    raise ConfigError(f"{arguments.cfg}: the agent has no safety glue; wrap the controllers in one")
