"""The command ``safe-inspect``: train, evaluate and draw policies, check experiments and safety filters."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from safe_inspect.cli.baseline import add_baseline_arguments, run_baseline
from safe_inspect.cli.common import add_experiment_arguments, guarded, parse
from safe_inspect.cli.evaluate import (
    add_compare_arguments,
    add_evaluate_arguments,
    run_compare,
    run_evaluate,
)
from safe_inspect.cli.export import add_export_arguments, run_export
from safe_inspect.cli.figures import (
    add_curves_arguments,
    add_draw_arguments,
    add_film_arguments,
    add_view_arguments,
    run_curves,
    run_draw,
    run_film,
    run_view,
)
from safe_inspect.cli.safety import add_acceptance_arguments, add_safety_arguments, run_acceptance, run_safety
from safe_inspect.cli.train import add_train_arguments, run_train
from safe_inspect.version import __version__


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0, or 2 for a mistake of the user's."""
    sys.path.insert(0, os.getcwd())  # as `python -m` does, so that a module beside the configuration can hold plugins
    parser = argparse.ArgumentParser(prog="safe-inspect", description=__doc__)
    parser.add_argument("--version", action="version", version=f"safe_inspect {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)

    listing = commands.add_parser("list", help="list the plugins with their fields, defaults and units")
    listing.add_argument("kind", nargs="?", help="only this kind, such as reward")
    listing.add_argument("name", nargs="?", help="only the plugin of this name")
    listing.set_defaults(run=_list)

    validate = commands.add_parser("validate", help="check an experiment file; Ray is not loaded")
    add_experiment_arguments(validate, positional=True)
    validate.set_defaults(run=_validate)

    schema = commands.add_parser("schema", help="print the JSON schema of a configuration file, for editors")
    schema.add_argument("file", nargs="?", default="experiment", help="kind of file (default: experiment)")
    schema.add_argument("--output", type=Path, help="write it to a file")
    schema.set_defaults(run=_schema)

    train = commands.add_parser("train", help="train a policy; the same as python -m safe_inspect.train_rl")
    add_train_arguments(train)
    train.set_defaults(run=run_train)

    safety = commands.add_parser("safety", help="fly adversaries under the safety filter and count violations")
    add_experiment_arguments(safety, positional=True)
    add_safety_arguments(safety)
    safety.set_defaults(run=run_safety)

    acceptance = commands.add_parser("acceptance", help="print which share of the drawn initial states is safe")
    add_experiment_arguments(acceptance, positional=True)
    add_acceptance_arguments(acceptance)
    acceptance.set_defaults(run=run_acceptance)

    for name, about, add, work in (
        ("evaluate", "fly policies or baselines and print what they achieve", add_evaluate_arguments, run_evaluate),
        ("compare", "put evaluations of the same episodes side by side", add_compare_arguments, run_compare),
        (
            "baseline",
            "optimise open-loop plans, or fly a baseline, episode by episode",
            add_baseline_arguments,
            run_baseline,
        ),
        ("draw", "draw an episode: in space, and its figures over time", add_draw_arguments, run_draw),
        ("film", "film an episode (GIF or MP4)", add_film_arguments, run_film),
        ("view", "write an episode as an interactive page that opens without a network", add_view_arguments, run_view),
        ("curves", "draw learning curves, with bands over training seeds", add_curves_arguments, run_curves),
        ("export", "write a trained policy as an ONNX file", add_export_arguments, run_export),
    ):
        command = commands.add_parser(name, help=about)
        add(command)
        command.set_defaults(run=work)

    arguments = parse(parser, argv)
    return guarded(arguments.run, arguments)


def _list(arguments: argparse.Namespace) -> int:
    from safe_inspect.cli.catalogue import catalogue

    print(catalogue(arguments.kind, arguments.name))
    return 0


def _validate(arguments: argparse.Namespace) -> int:
    from safe_inspect.config.experiment import load_experiment
    from safe_inspect.config.models.learning import check_learning
    from safe_inspect.experiments.runs.train import read_settings

    experiment = load_experiment(arguments.cfg, arguments.overrides, compute_platform=arguments.compute_platform)
    settings = check_learning(experiment, read_settings)
    for note in settings.notes:
        print(f"note: {note}", file=sys.stderr)
    agents = ", ".join(f"{agent.name} on {agent.platform}" for agent in experiment.spec.agents)
    print(f"{arguments.cfg} is valid: {experiment.algorithm}, {agents}")
    return 0


def _schema(arguments: argparse.Namespace) -> int:
    from safe_inspect.config.messages.file_schemas import FILES, file_schema
    from safe_inspect.errors import ConfigError, did_you_mean
    from safe_inspect.outputs import new_file

    if arguments.file not in FILES:
        raise ConfigError(f"no kind of file is called {arguments.file!r}; {did_you_mean(arguments.file, FILES)}")
    text = json.dumps(file_schema(arguments.file), indent=2, sort_keys=True)
    if arguments.output is None:
        print(text)
        return 0
    with new_file(arguments.output) as work:
        work.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
