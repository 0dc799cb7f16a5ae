"""The command ``safe-inspect evaluate``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from safe_inspect.cli.arguments import add_option, add_output_folder, positive
from safe_inspect.cli.flight_arguments import add_flight_arguments, prepared_flights, sources_of
from safe_inspect.cli.flights import fly_candidates
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation.policies import BASELINES
from safe_inspect.evaluation.results.files import write_json
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.results.tables import evaluation_table, pooled_table
from safe_inspect.experiments.modules.sources import DEFAULT_TASK, is_scripted
from safe_inspect.outputs import check_writable
from safe_inspect.rendezvous.experiment import is_rendezvous


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``evaluate``."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="folder of a checkpoint or a training run, ONNX file, or name of a "
        "policy (see `safe-inspect list policies`); none for a rendezvous, which its pilot flies; KEY=VALUE replaces a "
        "value of the configuration",
    )  # fmt: skip
    add_flight_arguments(parser)
    add_output_folder(parser, "the results")
    add_option(parser, "--record", "N", "record the trajectories of the first N episodes", positive)
    parser.set_defaults(overrides=[])


def run(arguments: argparse.Namespace) -> int:
    """Run episodes of policies and print what they achieve.

    An interrupted evaluation with --output continues where it stopped.

    Example:
        safe-inspect evaluate --policy docking --episodes 100 --output results/docking
    """
    sources = sources_of(arguments)
    if not sources and not (arguments.cfg is not None and is_rendezvous(arguments.cfg)):
        if arguments.cfg is not None:
            load_experiment(arguments.cfg, arguments.overrides)  # so that its mistakes are reported first
        raise SafeInspectError(
            "nothing to evaluate: give a checkpoint's folder, an ONNX file, the name of a baseline such as inspector, "
            "or --policy NAME"
        )
    if arguments.record and arguments.output is None:
        raise OutputError("--record writes trajectories into the folder of the results; give it with --output")
    arguments.episodes = arguments.episodes or 100
    if (arguments.record or 0) > arguments.episodes:
        raise OutputError(f"--record {arguments.record}: there are only {arguments.episodes} episodes; give --episodes")
    if arguments.json is not None:
        check_writable(arguments.json, [".json"])
    candidates, metrics, reference = prepared_flights(arguments, sources, None)
    scripted = [text for text in sources if is_scripted(text)]
    if arguments.cfg is None and len(scripted) == len(sources) and set(scripted) - set(BASELINES):  # of another task?
        print(f"note: {', '.join(scripted)} in {DEFAULT_TASK}; give another task with --cfg", file=sys.stderr)
    found = fly_candidates(arguments, candidates, metrics, reference, show=_print_tables)
    if arguments.json is not None:
        content = [{**item.record, "label": item.label, **item.as_dict()} for item in found]
        write_json(arguments.json, content[0] if len(content) == 1 else content)
    if arguments.output is not None:
        print(f"\nresults: {arguments.output}")
    return 0


def _print_tables(found: Sequence[Evaluation]) -> None:
    """Print the table of each evaluation, and a joint one if they are trainings of one recipe."""
    if found:
        print("\n\n".join(evaluation_table(item) for item in found))
    trained = all(item.record["source"]["kind"] != "scripted" for item in found)
    if len(found) > 1 and trained and len({frozenset(item.team.figures) for item in found}) == 1:
        print(f"\n{pooled_table(found)}")
