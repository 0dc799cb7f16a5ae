"""The command ``safe-inspect``: train, evaluate and draw policies, check experiments and safety filters."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from safe_inspect.baseline_commands import add_baseline_arguments, run_baseline
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation_commands import (
    add_compare_arguments,
    add_evaluate_arguments,
    run_compare,
    run_evaluate,
)
from safe_inspect.export_commands import add_export_arguments, run_export
from safe_inspect.figure_commands import (
    add_curves_arguments,
    add_draw_arguments,
    add_film_arguments,
    add_view_arguments,
    run_curves,
    run_draw,
    run_film,
    run_view,
)
from safe_inspect.interrupts import Interrupted, handled
from safe_inspect.outputs import NO_SPACE, cannot_write
from safe_inspect.safety_commands import add_acceptance_arguments, add_safety_arguments, run_acceptance, run_safety
from safe_inspect.version import __version__

USER_ERROR = 2


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
    from safe_inspect.train_rl import add_arguments, run

    add_arguments(train)
    train.set_defaults(run=run)

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


def parse(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command line whose overrides may stand anywhere; argparse alone takes them before the options only."""
    arguments, rest = parser.parse_known_args(argv)
    unknown = [text for text in rest if text.startswith("-") or "=" not in text or not hasattr(arguments, "overrides")]
    if unknown:
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    if rest:
        arguments.overrides = [*arguments.overrides, *rest]
    return arguments


def add_experiment_arguments(parser: argparse.ArgumentParser, *, positional: bool) -> None:
    """Add what names an experiment: its file, overrides and the compute platform."""
    if positional:
        parser.add_argument("cfg", metavar="CFG", help="experiment file")
    else:
        parser.add_argument("--cfg", metavar="CFG", help="experiment file")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="replaces a value, by its dotted path")
    parser.add_argument(
        "--compute-platform", default="local", metavar="NAME", help="which of the task's rllib_configs (default: local)"
    )


def guarded(command: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Run a command; return its exit code, which is 128 and the number of the signal that has stopped it.

    A mistake of the user's, a full disk and an interruption are printed without a traceback.
    """
    try:
        with handled():
            code = command(arguments)
            sys.stdout.flush()
            return code
    except SafeInspectError as error:
        _print_error(f"error: {error}" if "\n" not in str(error) else f"errors:\n{error}")
        return USER_ERROR
    except KeyboardInterrupt as stop:
        _print_error("; ".join(["interrupted", *getattr(stop, "__notes__", ())]))
        return 128 + (stop.number if isinstance(stop, Interrupted) else signal.SIGINT)
    except BrokenPipeError:  # of `| head`
        _discard_output()
        return 0
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        _discard_output()
        _print_error(f"error: {cannot_write(error.filename or 'standard output', error, 'write elsewhere')}")
        return USER_ERROR


def _print_error(text: str) -> None:
    with suppress(OSError):  # nobody may be there to read it
        print(text, file=sys.stderr)


def _discard_output() -> None:
    """Let what is still to be printed go nowhere: Python writes it at its end, and would complain."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _list(arguments: argparse.Namespace) -> int:
    from safe_inspect.catalogue import catalogue

    print(catalogue(arguments.kind, arguments.name))
    return 0


def _validate(arguments: argparse.Namespace) -> int:
    from safe_inspect.config.experiment import load_experiment
    from safe_inspect.config.learning import check_learning
    from safe_inspect.experiments.train import read_settings

    experiment = load_experiment(arguments.cfg, arguments.overrides, compute_platform=arguments.compute_platform)
    settings = check_learning(experiment, read_settings)
    for note in settings.notes:
        print(f"note: {note}", file=sys.stderr)
    agents = ", ".join(f"{agent.name} on {agent.platform}" for agent in experiment.spec.agents)
    print(f"{arguments.cfg} is valid: {experiment.algorithm}, {agents}")
    return 0


def _schema(arguments: argparse.Namespace) -> int:
    from safe_inspect.config.file_schemas import FILES, file_schema
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
