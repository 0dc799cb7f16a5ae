"""`PilotCandidate`: the autopilot of a rendezvous, for ``safe-inspect evaluate`` and ``compare``."""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from safe_inspect.cli.common import print_doubts, print_loading
from safe_inspect.config.loading.located import LocatedDict
from safe_inspect.config.overrides import apply_overrides
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.episodes import Episodes
from safe_inspect.evaluation.kept import KeptEpisodes
from safe_inspect.evaluation.missions import Flights, LocalFlights, fly_missions, mission_task
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.rendezvous.experiment import Rendezvous, build_rendezvous, is_rendezvous, load_rendezvous
from safe_inspect.rendezvous.missions.scenario import check_scenario

#: Name of the source.
_PILOT = "pilot"
#: Default of ``--num-envs``: number of episodes of an environment that are run at a time.
NUM_ENVS = 512


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
        self,
        episodes: int,
        seed: int,
        num_envs: int,
        *,
        kept: KeptEpisodes | None = None,
        progress: Callable[[int, int], None] | None = None,
        **_: Any,
    ) -> Episodes:
        """Run episodes; see `fly_missions`.

        Args:
            episodes: Number of episodes.
            seed: Seed of the experiment.
            num_envs: Has no effect: each episode is a separate batch.
            kept: Stored episodes, which are not run again.
            progress: Function that is called with (finished episodes, `episodes`).
        """
        return fly_missions(self.experiment, episodes, self.flights, kept, progress)


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
    for given, option in (
        (arguments.record, "--record"), (arguments.reference, "--reference"), (arguments.sampled is not None, "--mode"),
        (arguments.num_envs != NUM_ENVS, "--num-envs"),
    ):  # fmt: skip
        if given:
            raise SafeInspectError(
                f"{option} is only for environments, and {experiment.source} is a rendezvous; remove it"
            )
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
    from safe_inspect.experiments.runs.missions import RayFlights  # loads Ray

    return RayFlights(addresses[-1], workers)


def _experiment(cfg: str | None, overrides: Sequence[str], model: Evaluation | None) -> Rendezvous | None:
    if cfg is not None:
        return load_rendezvous(cfg, overrides) if is_rendezvous(cfg) else None
    if model is None or "rendezvous" not in model.record["task"]:
        return None
    tree = apply_overrides(LocatedDict(model.record["configuration"]), overrides)
    return build_rendezvous(tree, model.record["configuration_file"])
