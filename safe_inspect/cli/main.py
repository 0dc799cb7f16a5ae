"""The command ``safe-inspect``: train, evaluate and draw policies, check experiments and safety filters."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from safe_inspect.cli.baseline import add_baseline_arguments
from safe_inspect.cli.common import Parser, add_experiment_arguments, command_of, parse_arguments, run_command
from safe_inspect.cli.evaluate import (
    add_compare_arguments,
    add_evaluate_arguments,
)
from safe_inspect.cli.export import add_export_arguments
from safe_inspect.cli.figures import (
    add_curves_arguments,
    add_draw_arguments,
    add_film_arguments,
    add_view_arguments,
)
from safe_inspect.cli.leaderboard import add_leaderboard_arguments
from safe_inspect.cli.recording import add_characterise_arguments, add_record_log_arguments
from safe_inspect.cli.rendezvous import add_rendezvous_arguments
from safe_inspect.cli.safety import add_acceptance_arguments, add_safety_arguments
from safe_inspect.cli.train import add_train_arguments
from safe_inspect.version import __version__

_ABOUT = "Train, evaluate and draw policies, check experiments and safety filters; `COMMAND --help` tells more."


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0, or 2 for a mistake of the user's."""
    with suppress(FileNotFoundError):  # as `python -m` does: a module next to the configuration can hold plugins
        sys.path.insert(0, os.getcwd())
    arguments = parse_arguments(command_parser(), argv)
    return run_command(arguments.run, arguments)


def command_parser() -> Parser:
    """Return the parser of all commands."""
    parser = Parser(prog="safe-inspect", description=_ABOUT)
    parser.add_argument("--version", action="version", version=f"safe_inspect {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)

    listing = commands.add_parser("list", help="list tasks, policies, or plugins with their fields, defaults and units")
    listing.add_argument("kind", nargs="?", help="tasks, policies, or only plugins of this kind, such as reward")
    listing.add_argument("name", nargs="?", help="only the plugin of this name")
    listing.set_defaults(run=command_of("catalogue", "run_list"))

    validate = commands.add_parser("validate", help="check an experiment file; Ray is not loaded")
    add_experiment_arguments(validate)
    validate.set_defaults(run=command_of("catalogue", "run_validate"))

    schema = commands.add_parser("schema", help="print the JSON schema of a configuration file, for editors")
    schema.add_argument("file", nargs="?", default="experiment", help="kind of file (default: experiment)")
    schema.add_argument("--output", type=Path, help="write it to a file")
    schema.set_defaults(run=command_of("catalogue", "run_schema"))

    train = commands.add_parser("train", help="train a policy; the same as python -m safe_inspect.train_rl")
    add_train_arguments(train)
    train.set_defaults(run=command_of("train", "run_train"))

    warm = commands.add_parser(
        "warm",
        help="compile ahead what environments need, for a container image or CI",
        description="Compile ahead what environments need, so that their first use does not wait: for a container "
        "image, or a cache of CI. The machine code serves the processor that it is compiled on; where another one uses "
        "it, set NUMBA_CPU_NAME=generic for both.",
        epilog="example: safe-inspect warm safe_inspect/FilteredTranslationalInspection-v1",
    )
    warm.add_argument(
        "files", nargs="*", metavar="FILE", help="experiment file, or id of a task (default: all shipped tasks)"
    )
    warm.set_defaults(run=command_of("warm", "run_warm"))

    safety = commands.add_parser("safety", help="fly adversaries under the safety filter and count violations")
    add_experiment_arguments(safety)
    add_safety_arguments(safety)
    safety.set_defaults(run=command_of("safety", "run_safety"))

    acceptance = commands.add_parser("acceptance", help="print which share of the drawn initial states is safe")
    add_experiment_arguments(acceptance)
    add_acceptance_arguments(acceptance)
    acceptance.set_defaults(run=command_of("safety", "run_acceptance"))

    starting = "loading; compiling takes a minute where this machine has not done it yet"
    for name, module, about, add in (
        ("evaluate", "evaluate", "fly policies or baselines and print what they achieve", add_evaluate_arguments),
        ("compare", "evaluate", "put evaluations of the same episodes side by side", add_compare_arguments),
        (
            "leaderboard",
            "leaderboard",
            "fly baselines, shipped policies and yours on the same episodes; write a table",
            add_leaderboard_arguments,
        ),
        (
            "baseline",
            "baseline",
            "optimise open-loop plans, or fly a baseline, episode by episode",
            add_baseline_arguments,
        ),
        (
            "rendezvous",
            "rendezvous",
            "fly to a point of a tumbling target and print how it went",
            add_rendezvous_arguments,
        ),
        (
            "record-log",
            "recording",
            "record depth frames and inertial samples of a simulated tumbling target",
            add_record_log_arguments,
        ),
        (
            "characterise",
            "recording",
            "estimate how a target tumbles from a sensor log",
            add_characterise_arguments,
        ),
        ("draw", "figures", "draw an episode: in space, and its figures over time", add_draw_arguments),
        ("film", "figures", "film an episode (GIF or MP4)", add_film_arguments),
        ("view", "figures", "write an episode as an interactive page that opens without a network", add_view_arguments),
        ("curves", "figures", "draw learning curves, with bands over training seeds", add_curves_arguments),
        ("export", "export", "write a trained policy as an ONNX file", add_export_arguments),
    ):
        command = commands.add_parser(name, help=about)
        add(command)
        flies = module in ("rendezvous", "recording")
        command.set_defaults(run=command_of(module, f"run_{name.replace('-', '_')}", starting if flies else ""))
    return parser


if __name__ == "__main__":
    sys.exit(main())
