"""`fly_candidates`: runs and stores the episodes of policies, and of the pilot of a rendezvous, for the commands."""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shlex
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, ClassVar, TypeAlias

from safe_inspect.cli.arguments import refuse_options
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.streams import print_doubts, print_loading
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.episodes import Episodes
from safe_inspect.evaluation.kept import KeptEpisodes, kept_episodes
from safe_inspect.evaluation.missions import Flights, LocalFlights, fly_missions, mission_task
from safe_inspect.evaluation.results.files import sha256, write_evaluation
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.experiments.modules.run_folder import git_commit
from safe_inspect.experiments.modules.sources import Candidate
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.missions.scenario import check_scenario
from safe_inspect.outputs import check_new_folder, new_folder
from safe_inspect.plugins.functor import describe
from safe_inspect.rendezvous.experiment import Rendezvous, build_rendezvous, is_rendezvous, load_rendezvous
from safe_inspect.types import FloatArray
from safe_inspect.version import __version__

#: Name of the source.
_PILOT = "pilot"
#: Default of ``--num-envs``: number of episodes of an environment that are run at a time.
NUM_ENVS = 512
#: Entries of a record that may differ between an interrupted evaluation and its continuation.
_VOLATILE = {"date", "command"}


@dataclass(frozen=True, eq=False)
class PilotCandidate:
    """The flight computer of a rendezvous experiment as the candidate of an evaluation; see `Candidate`.

    Attributes:
        experiment: The experiment; its seed is that of the episodes.
        flights: Runner of the episodes.
        label: Name of the candidate in tables.
        price: An empty string, because there are no rewards.
    """

    experiment: Rendezvous
    flights: Flights
    label: ClassVar[str] = _PILOT
    price: ClassVar[str] = ""

    @property
    def source(self) -> dict[str, Any]:
        """Description of the source: ``text``, ``kind``, ``path`` and ``sha256``."""
        digest = hashlib.sha256(json.dumps(self.experiment.resolved, sort_keys=True, default=str).encode())
        return {"text": _PILOT, "kind": "scripted", "path": None, "sha256": digest.hexdigest()}

    @property
    def task(self) -> dict[str, Any]:
        """Properties that must be equal in evaluations that are compared."""
        return mission_task(self.experiment.config)

    def measured(self, metrics: Sequence[BaseMetric]) -> list[BaseMetric]:
        """Return no metrics, because a mission has its own results.

        Raises:
            SafeInspectError: Metrics are given.
        """
        if metrics:
            raise SafeInspectError("--metric is only for environments, not for a rendezvous; remove it")
        return []

    def fly(
        self, episodes: int, *_: Any, kept: KeptEpisodes | None = None, progress: Any = None, **__: Any
    ) -> Episodes:
        """Run episodes; see `fly_missions`.

        Args:
            episodes: Number of episodes.
            _: Seed, which is that of the experiment, and number of environments; each episode is a separate batch.
            kept: Stored episodes, which are not run again.
            progress: Function that is called with (finished episodes, `episodes`).
            __: Arguments of `Candidate.fly` that have no effect on missions.
        """
        return fly_missions(self.experiment, episodes, self.flights, kept, progress)


AnyCandidate: TypeAlias = Candidate | PilotCandidate


def open_pilot(
    arguments: argparse.Namespace, sources: Sequence[str], model: Evaluation | None
) -> PilotCandidate | None:
    """Return the pilot of the rendezvous experiment on the command line, or None if there is none.

    Args:
        arguments: Arguments of `evaluate`; the default seed becomes that of the experiment.
        sources: The given sources.
        model: An evaluation whose experiment is the default.

    Raises:
        ConfigError: The experiment has mistakes.
        SafeInspectError: There are sources other than the pilot, or options that only apply to environments.
    """
    overrides = [text for text in arguments.overrides if not text.startswith("address=")]
    if arguments.seed is not None:
        overrides.append(f"seed={arguments.seed}")
    experiment = _experiment(arguments.cfg, overrides, model)
    if experiment is None:
        if arguments.workers is not None:
            raise SafeInspectError(
                "--workers is only for a rendezvous; an environment runs --num-envs episodes at a time"
            )
        return None
    others = [text for text in sources if text != _PILOT]
    if others:
        raise SafeInspectError(
            f"{others[0]}: a rendezvous is controlled by its pilot; remove the source, and choose the parts "
            "with KEY=VALUE, such as tracker={functor: LQRTracker}"
        )
    refuse_options(
        {
            "--record": arguments.record, "--reference": arguments.reference, "--mode": arguments.sampled is not None,
            "--num-envs": arguments.num_envs != NUM_ENVS,
        },
        f"is only for environments, and {experiment.source} is a rendezvous",
    )  # fmt: skip
    print_loading()
    print_doubts(check_scenario(experiment, arguments.episodes))
    arguments.seed, arguments.num_envs = experiment.config.seed, 1
    return PilotCandidate(experiment, _flights(arguments))


def _flights(arguments: argparse.Namespace) -> Flights:
    """Return the runner of the missions: processes on this machine, or Ray if `address` is given."""
    addresses = [text.partition("=")[2] for text in arguments.overrides if text.startswith("address=")]
    workers = arguments.workers or 1
    if not addresses:
        return LocalFlights(workers)
    from safe_inspect.experiments.runs.cluster import RayFlights  # loads Ray

    return RayFlights(addresses[-1], workers)


def _experiment(cfg: str | None, overrides: Sequence[str], model: Evaluation | None) -> Rendezvous | None:
    if cfg is not None:
        return load_rendezvous(cfg, overrides) if is_rendezvous(cfg) else None
    if model is None or "rendezvous" not in model.record["task"]:
        return None
    return build_rendezvous(model.record["configuration"], model.record["configuration_file"], overrides)


def fly_candidates(
    arguments: argparse.Namespace,
    candidates: Sequence[AnyCandidate],
    metrics: Sequence[BaseMetric],
    reference: FloatArray | None,
    show: Callable[[Sequence[Evaluation]], None] | None = None,
) -> list[Evaluation]:
    """Run the episodes of candidates, and write their evaluations into the folder of ``--output``.

    If an earlier call with the same arguments was interrupted, it is continued from the episodes that were stored.

    Args:
        arguments: Arguments of `evaluate`.
        candidates: The policies to evaluate.
        metrics: Additional metrics.
        reference: Delta-v of the open-loop optimum of every episode [m/s].
        show: Function that is called with the evaluations before they are written, in case the disk is full.
    """
    output = arguments.output
    if output is not None:
        check_new_folder(output, arguments.command, force=arguments.force)
    flights: dict[str, tuple[AnyCandidate, list[BaseMetric], Mapping[str, Any]]] = {}
    for candidate in candidates:
        measured = candidate.measured(metrics)
        flights[_new_name(candidate.label, flights)] = candidate, measured, _record(arguments, candidate, measured)
    count = arguments.episodes * len(flights)
    found: list[Evaluation] = []
    records = {
        name: {key: value for key, value in record.items() if key not in _VOLATILE}
        for name, (_, _, record) in flights.items()
    }
    with kept_episodes(
        output, arguments.command, records, num_envs=arguments.num_envs, force=arguments.force
    ) as stored:
        for (candidate, measured, record), kept in zip(flights.values(), stored, strict=True):
            try:
                with EpisodeBar(candidate.label) as bar:
                    episodes = candidate.fly(
                        arguments.episodes, arguments.seed, arguments.num_envs, record=arguments.record or 0,
                        metrics=measured, progress=bar.show, kept=kept,
                    )  # fmt: skip
            except KeyboardInterrupt as stop:
                if output is None:
                    done = arguments.episodes * len(found) + bar.done
                    stop.add_note(f"{done:,} of {count:,} episodes were run and are lost; --output FOLDER stores them")
                raise
            found.append(Evaluation.of(candidate.label, episodes, record, reference=reference))
        if show is not None:
            show(found)
        if output is not None:
            with new_folder(output, arguments.command, force=arguments.force) as folder:
                for name, item in zip(flights, found, strict=True):
                    write_evaluation(item, folder if len(found) == 1 else folder / name)
    return found


def _new_name(label: str, taken: Collection[str]) -> str:
    """Return a label as the name of a folder that is not used yet."""
    name = re.sub(r"[^\w.-]+", "-", label).strip(".-") or "evaluation"
    return next(text for text in (name, *(f"{name}-{k}" for k in range(2, len(taken) + 3))) if text not in taken)


def _record(arguments: argparse.Namespace, candidate: AnyCandidate, metrics: Sequence[BaseMetric]) -> Mapping[str, Any]:
    """Return the record that identifies an evaluation."""
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
        "price": candidate.price,
        "task": candidate.task,
        "configuration_file": candidate.experiment.source,
        "overrides": list(arguments.overrides),
        "configuration": candidate.experiment.resolved,
    }
