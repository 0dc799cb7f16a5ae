"""The command ``safe-inspect compare``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace

from safe_inspect.cli.arguments import add_output_folder, refuse_options
from safe_inspect.cli.flight_arguments import add_flight_arguments, prepared_flights, sources_of
from safe_inspect.cli.flights import fly_candidates
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation.results.files import is_evaluation, read_evaluation, write_json
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.results.tables import compare
from safe_inspect.outputs import check_writable


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``compare``."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="folder of an evaluation, or a source of `evaluate`, which "
        "is run on the episodes of the first evaluation; every source is compared with the first",
    )  # fmt: skip
    add_flight_arguments(parser)
    add_output_folder(parser, "the evaluations that are flown")
    parser.set_defaults(overrides=[], record=None)


def run(arguments: argparse.Namespace) -> int:
    """Compare policies on the same episodes.

    Differences are paired by episode and have bootstrap intervals.

    Example:
        safe-inspect compare results/docking zero-thrust
    """
    sources = sources_of(arguments)
    if len(sources) < 2:
        twice = len(arguments.words) + len(arguments.policy) - len(arguments.overrides) > 1
        what = f"{sources[0]} is given twice; give another one" if twice else "`compare` needs two or more sources"
        raise SafeInspectError(f"{what}; give folders of evaluations, or sources of `evaluate`")
    if arguments.json is not None:
        check_writable(arguments.json, [".json"])
    found = {text: read_evaluation(text) for text in sources if is_evaluation(text)}
    first = next(iter(found.values()), None)
    given = first.record if first is not None else {}
    _check_unused(arguments, sources, found)
    arguments.episodes = arguments.episodes or given.get("episodes", 100)
    arguments.seed = given.get("seed") if arguments.seed is None else arguments.seed
    flown = [text for text in sources if text not in found]
    if flown:
        prepared = prepared_flights(arguments, flown, first)
        found |= dict(zip(flown, fly_candidates(arguments, *prepared), strict=True))
    elif arguments.output is not None:
        raise OutputError("--output stores new evaluations, but all sources are evaluations already; remove it")
    labels = [item.label for item in found.values()]
    chosen = [
        found[text] if labels.count(found[text].label) == 1 else replace(found[text], label=text) for text in sources
    ]
    comparison = compare(chosen)
    print(comparison)
    if arguments.json is not None:
        write_json(arguments.json, comparison.as_dict())
    return 0


def _check_unused(arguments: argparse.Namespace, sources: Sequence[str], found: Mapping[str, Evaluation]) -> None:
    """Raise an error for options without effect, because their episodes have already been evaluated."""
    for text, evaluation in found.items():
        for name in ("episodes", "seed"):
            wanted, flown = getattr(arguments, name), evaluation.record[name]
            if wanted is not None and wanted != flown:
                raise SafeInspectError(
                    f"--{name} {wanted}: {text} has --{name} {flown} and is not evaluated again; leave it out"
                )
    options = {
        "--metric": arguments.metric, "--cfg": arguments.cfg, "--reference": arguments.reference,
        "KEY=VALUE": arguments.overrides,
    }  # fmt: skip
    if len(found) == len(sources):
        refuse_options(options, "has no effect, as all sources are evaluations already")
