"""The commands ``safe-inspect evaluate`` and ``safe-inspect compare``."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safe_inspect.cli.arguments import positive, seed
from safe_inspect.errors import OutputError, SafeInspectError

if TYPE_CHECKING:
    from safe_inspect.cli.sources import Candidate
    from safe_inspect.evaluation.results.results import Evaluation
    from safe_inspect.metrics import BaseMetric
    from safe_inspect.types import FloatArray


def add_evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the evaluation."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="a checkpoint's or a run's folder, an ONNX file, or the name of a "
        "baseline (zero-thrust, random, inspector), of any scripted policy or of a shipped one; and KEY=VALUE to "
        "replace values",
    )  # fmt: skip
    parser.add_argument("--policy", action="append", default=[], metavar="NAME", help="a policy that the package ships")
    _add_flight_arguments(parser)
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="write the results into this new folder")
    parser.add_argument("--force", action="store_true", help="replace the evaluation that is in the folder")
    parser.add_argument("--record", type=positive, metavar="K", help="write the trajectories of the first K episodes")
    parser.set_defaults(overrides=[])


def add_compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the comparison."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="the folder of an evaluation; or what `evaluate` takes, flown in "
        "the episodes of the first evaluation; the others are compared with the first",
    )  # fmt: skip
    parser.add_argument("--policy", action="append", default=[], metavar="NAME", help="a policy that the package ships")
    _add_flight_arguments(parser)
    parser.set_defaults(overrides=[], record=None)


def _add_flight_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--cfg",
        metavar="CFG",
        help="experiment file or id of a task (default: the one that each policy was trained in)",
    )
    parser.add_argument("--episodes", type=positive, help="number of episodes (default: 100)")
    parser.add_argument("--seed", type=seed, help="seed of the episodes (default: 0)")
    parser.add_argument("--num-envs", type=positive, default=256, help="episodes at a time (default: 256)")
    drawn = parser.add_mutually_exclusive_group()
    drawn.add_argument(
        "--sampled",
        action="store_const",
        const=True,
        help="draw actions from the policy's distribution (as categorical policies do in any case)",
    )
    drawn.add_argument(
        "--mode", dest="sampled", action="store_const", const=False, help="take the most likely action, or the mean"
    )
    parser.add_argument(
        "--metric", action="append", default=[], metavar="METRIC", help="measure this too: a name of `safe-inspect "
        "list metric`, a dotted path, or {functor: NAME, config: {...}}",
    )  # fmt: skip
    parser.add_argument("--reference", type=Path, metavar="FILE", help="delta-v of the open-loop optimum, by episode")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    parser.add_argument(
        "--compute-platform", default="local", metavar="NAME", help="which of the task's rllib_configs (default: local)"
    )


def run_evaluate(arguments: argparse.Namespace) -> int:
    """Fly every source and print its table."""
    from safe_inspect.evaluation.results.folder import new_evaluation, write_evaluation, write_json
    from safe_inspect.outputs import check_writable

    sources = _sources(arguments)
    if not sources:
        raise SafeInspectError(
            "nothing to evaluate: give a checkpoint's folder, an ONNX file, the name of a baseline such as inspector, "
            "or --policy NAME"
        )
    if arguments.record and arguments.output is None:
        raise OutputError("--record writes trajectories into the folder of the results; give it with --output")
    arguments.episodes, arguments.seed = arguments.episodes or 100, arguments.seed or 0
    if arguments.json is not None:
        check_writable(arguments.json)
    candidates, metrics, reference = _prepared(arguments, sources, None)
    found: list[Evaluation] = []
    try:
        with ExitStack() as stack:
            folder = None
            if arguments.output is not None:
                folder = stack.enter_context(new_evaluation(arguments.output, force=arguments.force))
            try:
                found += [_fly(arguments, candidate, metrics, reference) for candidate in candidates]
            except KeyboardInterrupt as stop:
                stop.add_note("nothing is written")
                raise
            for item in found if folder is not None else ():
                assert folder is not None
                write_evaluation(item, folder if len(found) == 1 else folder / _file_name(item.label))
    finally:  # a full disk does not lose what was flown
        _print_tables(found)
    if arguments.json is not None:
        told = [{**item.record, "label": item.label, **item.as_dict()} for item in found]
        write_json(arguments.json, told[0] if len(told) == 1 else told)
    if arguments.output is not None:
        print(f"\nresults: {arguments.output}")
    return 0


def _print_tables(found: Sequence[Evaluation]) -> None:
    """Print the table of each evaluation, and of all together where they are trainings of one recipe."""
    from safe_inspect.evaluation.results.tables import evaluation_table, pooled_table

    if found:
        print("\n\n".join(evaluation_table(item) for item in found))
    trained = all(item.record["source"]["kind"] != "scripted" for item in found)
    if len(found) > 1 and trained and len({frozenset(item.team.figures) for item in found}) == 1:
        print(f"\n{pooled_table(found)}")


def run_compare(arguments: argparse.Namespace) -> int:
    """Print evaluations of the same episodes side by side."""
    from safe_inspect.evaluation.results.comparison import compare
    from safe_inspect.evaluation.results.folder import is_evaluation, read_evaluation, write_json
    from safe_inspect.outputs import check_writable

    sources = _sources(arguments)
    if len(sources) < 2:
        raise SafeInspectError("two or more are compared; give folders of evaluations, or what `evaluate` takes")
    if arguments.json is not None:
        check_writable(arguments.json)
    found = {text: read_evaluation(text) for text in sources if is_evaluation(text)}
    first = next(iter(found.values()), None)
    given = first.record if first is not None else {}
    arguments.episodes = arguments.episodes or given.get("episodes", 100)
    arguments.seed = given.get("seed", 0) if arguments.seed is None else arguments.seed
    flown = [text for text in sources if text not in found]
    if flown:
        candidates, metrics, reference = _prepared(arguments, flown, first)
        for text, candidate in zip(flown, candidates, strict=True):
            found[text] = _fly(arguments, candidate, metrics, reference)
    labels = [item.label for item in found.values()]
    chosen = [
        found[text] if labels.count(found[text].label) == 1 else replace(found[text], label=text) for text in sources
    ]
    comparison = compare(chosen)
    print(comparison)
    if arguments.json is not None:
        write_json(arguments.json, comparison.as_dict())
    return 0


def _sources(arguments: argparse.Namespace) -> list[str]:
    """Return the sources among the words; the others are overrides."""
    words = [*arguments.words]
    texts = [word for word in words if "=" not in word or Path(word).exists()]
    arguments.overrides = [*(word for word in words if word not in texts), *arguments.overrides]
    from safe_inspect.cli.sources import SHIPPED

    texts += [f"{SHIPPED}{name}" for name in arguments.policy]
    return list(dict.fromkeys(texts))


def _prepared(
    arguments: argparse.Namespace, sources: Sequence[str], model: Evaluation | None
) -> tuple[list[Candidate], list[BaseMetric], FloatArray | None]:
    """Check all that can be wrong before an episode is flown; return who flies, what is measured, and the reference."""
    from safe_inspect.cli.sources import Wanted, open_candidates
    from safe_inspect.evaluation.results.reference import read_reference
    from safe_inspect.evaluation.rollouts.gauges import check_metrics
    from safe_inspect.evaluation.task import default_metrics, read_metrics, task_of

    wanted = Wanted(arguments.cfg, arguments.overrides, arguments.compute_platform, arguments.sampled, arguments.seed)
    if model is not None and arguments.cfg is None:
        wanted = replace(wanted, usual=wanted.build(model.record["configuration"], model.label))
    candidates = open_candidates(sources, wanted)
    metrics = read_metrics(arguments.metric)
    own = {metric.label for metric in metrics}
    for candidate in candidates:
        check_metrics(candidate.spec, [*metrics, *(m for m in default_metrics(candidate.spec) if m.label not in own)])
    reference = None
    for candidate in candidates if arguments.reference is not None else ():
        task = task_of(candidate.experiment.spec)
        reference = read_reference(arguments.reference, arguments.seed, arguments.episodes, task)
    return candidates, metrics, reference


def _fly(
    arguments: argparse.Namespace,
    candidate: Candidate,
    metrics: Sequence[BaseMetric],
    reference: FloatArray | None,
) -> Evaluation:
    """Fly the episodes of a candidate."""
    from safe_inspect.cli.episode_bar import EpisodeBar
    from safe_inspect.evaluation.results.results import Evaluation
    from safe_inspect.evaluation.rollouts.rollout import rollout
    from safe_inspect.evaluation.task import default_metrics, points_of

    task = candidate.experiment.spec
    own = {metric.label for metric in metrics}
    measured = [*metrics, *(metric for metric in default_metrics(task) if metric.label not in own)]
    bar = EpisodeBar(candidate.label, sys.stderr)
    try:
        episodes = rollout(
            candidate.spec,
            candidate.policies,
            arguments.episodes,
            arguments.seed,
            arguments.num_envs,
            record=arguments.record or 0,
            metrics=measured,
            progress=bar.show,
        )
    finally:
        bar.close()
    models = getattr(task.simulator, "inspection_points_map", {})
    points = sum(_count(models[name]) for name in points_of(task))
    return Evaluation.of(
        candidate.label, episodes, _record(arguments, candidate, measured), points=points, reference=reference
    )


def _count(points: Any) -> int:
    from safe_inspect.geometry.sphere import sphere_points

    return len(sphere_points(points.points_algorithm, points.num_points, points.radius))


def _record(arguments: argparse.Namespace, candidate: Candidate, metrics: Sequence[BaseMetric]) -> Mapping[str, Any]:
    """Return what an evaluation is."""
    from safe_inspect.evaluation.results.folder import sha256
    from safe_inspect.evaluation.task import price_of, task_of
    from safe_inspect.experiments.runs.run_folder import git_commit
    from safe_inspect.plugins.functor import describe
    from safe_inspect.version import __version__

    reference = arguments.reference
    return {
        "safe_inspect": __version__,
        "git_commit": git_commit(),
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "command": shlex.join(["safe-inspect", *sys.argv[1:]]),
        "source": candidate.source,
        "seed": arguments.seed,
        "episodes": arguments.episodes,
        "sampled": arguments.sampled,
        "recorded": arguments.record or 0,
        "metrics": [describe(metric) for metric in metrics],
        "reference": None if reference is None else {"path": str(reference), "sha256": sha256(reference)},
        "price": price_of(candidate.experiment.spec),
        "task": task_of(candidate.experiment.spec),
        "configuration_file": candidate.experiment.source,
        "overrides": list(arguments.overrides),
        "configuration": candidate.experiment.resolved,
    }


def _file_name(label: str) -> str:
    return re.sub(r"[^\w.-]+", "-", label).strip(".-") or "evaluation"
