"""Arguments of the commands that run episodes of policies, and what they name."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from safe_inspect.cli.arguments import add_compute_platform, add_option, equals_hint, is_override, positive, seed
from safe_inspect.cli.flights import NUM_ENVS, AnyCandidate, open_pilot
from safe_inspect.cli.streams import print_error
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.baselines import read_reference
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.task import read_metrics
from safe_inspect.experiments.modules.sources import SHIPPED, Candidate, Wanted, open_candidates
from safe_inspect.metrics import BaseMetric
from safe_inspect.types import FloatArray


def add_flight_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that determine which episodes are run, and what is measured."""
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


def _print_unused(candidate: Candidate) -> None:
    """Print the agents whose checkpoint is not used, because a single policy flies all agents."""
    flown = candidate.policies
    unused = [name for one in candidate.experiment.policies.values() if not one.trains for name in one.agents]
    if unused and (not isinstance(flown, Mapping) or len({id(policy) for policy in flown.values()}) == 1):
        text = f"{candidate.label} flies every agent that is controlled from outside, so the `checkpoint` of"
        print_error(f"note: {text} {', '.join(unused)} is not used")


def sources_of(arguments: argparse.Namespace) -> list[str]:
    """Return the sources among the words of the command line; the others are overrides."""
    texts = [word for word in arguments.words if not is_override(word)]
    arguments.overrides = [*filter(is_override, arguments.words), *arguments.overrides]
    for text in texts:
        if ":" in text and not os.path.exists(text):
            raise SafeInspectError(f"there is no policy {text!r}; {equals_hint(text)}")
    texts += [f"{SHIPPED}{name}" for name in arguments.policy]
    return list(dict.fromkeys(texts))


def prepared_flights(
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
        _print_unused(candidate)
    reference = None
    for candidate in candidates if arguments.reference is not None else ():
        reference = read_reference(arguments.reference, arguments.seed, arguments.episodes, candidate.task)
    return candidates, metrics, reference
