"""The commands ``safe-inspect evaluate`` and ``safe-inspect compare``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from safe_inspect.cli.arguments import add_option, add_output_folder, positive, seed
from safe_inspect.cli.common import add_compute_platform, equals_hint, is_override, refuse_options
from safe_inspect.cli.flights import NUM_ENVS, AnyCandidate, fly_candidates, open_pilot
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation.baselines import read_reference
from safe_inspect.evaluation.policies import BASELINES
from safe_inspect.evaluation.results.files import is_evaluation, read_evaluation, write_json
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.results.tables import compare, evaluation_table, pooled_table
from safe_inspect.evaluation.task import read_metrics
from safe_inspect.experiments.modules.sources import DEFAULT_TASK, SHIPPED, Wanted, is_scripted, open_candidates
from safe_inspect.metrics import BaseMetric
from safe_inspect.outputs import check_writable
from safe_inspect.rendezvous.experiment import is_rendezvous
from safe_inspect.types import FloatArray


def add_evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``evaluate``."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="folder of a checkpoint or a training run, ONNX file, or name of a "
        "policy (see `safe-inspect list policies`); none for a rendezvous, which its pilot flies; KEY=VALUE replaces a "
        "value of the configuration",
    )  # fmt: skip
    _add_flight_arguments(parser)
    add_output_folder(parser, "the results")
    add_option(parser, "--record", "N", "record the trajectories of the first N episodes", positive)
    parser.set_defaults(overrides=[])


def add_compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``compare``."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="folder of an evaluation, or a source of `evaluate`, which "
        "is run on the episodes of the first evaluation; every source is compared with the first",
    )  # fmt: skip
    _add_flight_arguments(parser)
    add_output_folder(parser, "the evaluations that are flown")
    parser.set_defaults(overrides=[], record=None)


def _add_flight_arguments(parser: argparse.ArgumentParser) -> None:
    append: dict[str, Any] = {"action": "append", "default": []}
    add_option(parser, "--policy", "NAME", "a trained policy of the package", **append)
    cfg = "experiment file or id of a task (default: the task in which each policy was trained)"
    add_option(parser, "--cfg", "FILE", cfg)
    add_option(parser, "--episodes", "N", "number of episodes (default: 100)", positive)
    add_option(parser, "--seed", "N", "seed of the episodes (default: 0)", seed)
    add_option(parser, "--num-envs", "N", "number of episodes run at a time", positive, NUM_ENVS)
    add_option(
        parser, "--workers", "N", "number of missions of a rendezvous flown at a time, each in a process (default: 1); "
        "by Ray with address=auto (or HOST:PORT, or local)", positive,
    )  # fmt: skip
    drawn = parser.add_mutually_exclusive_group()
    sampled = "draw actions from the policy's distribution (as categorical policies do in any case)"
    drawn.add_argument("--sampled", action="store_const", const=True, help=sampled)
    mode = "take the most likely action, or the mean"
    drawn.add_argument("--mode", dest="sampled", action="store_const", const=False, help=mode)
    metric = "additional metric: a name from `safe-inspect list metric`, a dotted path, or "
    add_option(parser, "--metric", "NAME", f"{metric}{{functor: NAME, config: {{...}}}}", **append)
    reference = "file of `safe-inspect baseline optimiser`; adds the ratio to the optimum"
    add_option(parser, "--reference", "FILE", reference, Path)
    add_option(parser, "--json", "FILE", "write the results to this file", Path)
    add_compute_platform(parser)


def run_evaluate(arguments: argparse.Namespace) -> int:
    """Run episodes of policies and print what they achieve.

    An interrupted evaluation with --output continues where it stopped.

    Example:
        safe-inspect evaluate --policy docking --episodes 100 --output results/docking
    """
    sources = _sources(arguments)
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
    candidates, metrics, reference = _prepared(arguments, sources, None)
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


def run_compare(arguments: argparse.Namespace) -> int:
    """Compare policies on the same episodes.

    Differences are paired by episode and have bootstrap intervals.

    Example:
        safe-inspect compare results/docking zero-thrust
    """
    sources = _sources(arguments)
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
        prepared = _prepared(arguments, flown, first)
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


def _sources(arguments: argparse.Namespace) -> list[str]:
    """Return the sources among the words of the command line; the others are overrides."""
    texts = [word for word in arguments.words if not is_override(word)]
    arguments.overrides = [*filter(is_override, arguments.words), *arguments.overrides]
    for text in texts:
        if ":" in text and not os.path.exists(text):
            raise SafeInspectError(f"there is no policy {text!r}; {equals_hint(text)}")
    texts += [f"{SHIPPED}{name}" for name in arguments.policy]
    return list(dict.fromkeys(texts))


def _prepared(
    arguments: argparse.Namespace, sources: Sequence[str], model: Evaluation | None
) -> tuple[Sequence[AnyCandidate], list[BaseMetric], FloatArray | None]:
    """Check everything that can be wrong before an episode starts; return candidates, metrics and the reference."""
    metrics = read_metrics(arguments.metric)
    pilot = open_pilot(arguments, sources, model)
    if pilot is not None:
        return [pilot], pilot.measured(metrics), None
    arguments.seed = arguments.seed or 0
    wanted = Wanted(arguments.cfg, arguments.overrides, arguments.compute_platform, arguments.sampled, arguments.seed)
    if model is not None and arguments.cfg is None:
        wanted = replace(wanted, usual=wanted.build(model.record["configuration"], model.label))
    candidates = open_candidates(sources, wanted)
    for candidate in candidates:
        candidate.measured(metrics)
    reference = None
    for candidate in candidates if arguments.reference is not None else ():
        reference = read_reference(arguments.reference, arguments.seed, arguments.episodes, candidate.task)
    return candidates, metrics, reference
