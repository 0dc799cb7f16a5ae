"""`PilotCandidate`: the pilot of a rendezvous, for ``safe-inspect evaluate`` and ``compare``."""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

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
from safe_inspect.rendezvous.scenario import check_scenario

#: The name of the source.
_PILOT = "pilot"
#: Episodes of an environment that are flown at a time unless ``--num-envs`` is given.
NUM_ENVS = 512


@dataclass(frozen=True, eq=False)
class PilotCandidate:
    """The flight computer of a rendezvous experiment, which is to be evaluated; see `Candidate`.

    Attributes:
        experiment: The experiment; its seed is that of the episodes.
        flights: What flies the episodes.
    """

    experiment: Rendezvous
    flights: Flights

    @property
    def label(self) -> str:
        """Name in tables."""
        return _PILOT

    @property
    def source(self) -> dict[str, Any]:
        """What it is: ``text``, ``kind``, ``path`` and ``sha256``."""
        digest = hashlib.sha256(json.dumps(self.experiment.resolved, sort_keys=True, default=str).encode())
        return {"text": _PILOT, "kind": "scripted", "path": None, "sha256": digest.hexdigest()}

    @property
    def task(self) -> dict[str, Any]:
        """What evaluations must have in common to be compared."""
        return mission_task(self.experiment.config)

    @property
    def price(self) -> str:
        """Nothing: there are no rewards."""
        return ""

    def measured(self, metrics: Sequence[BaseMetric]) -> list[BaseMetric]:
        """Return no metrics: the figures of a mission are its own.

        Raises:
            SafeInspectError: Some are given.
        """
        if metrics:
            raise SafeInspectError(
                "--metric is for environments; the figures of a rendezvous are its own: leave it out"
            )
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
        """Fly episodes; see `fly_missions`.

        Args:
            episodes: How many.
            seed: That of the experiment.
            num_envs: Has no effect: each episode is a separate batch.
            kept: Those that are not flown again.
            progress: Called with (finished episodes, `episodes`).
        """
        return fly_missions(self.experiment, episodes, self.flights, kept, progress)


def open_pilot(
    arguments: argparse.Namespace, sources: Sequence[str], model: Evaluation | None
) -> PilotCandidate | None:
    """Return the pilot of the rendezvous experiment that a command line names; None where it names none.

    Args:
        arguments: Those of `evaluate`; the seed becomes that of the experiment where none is given.
        sources: The sources that are to fly.
        model: The evaluation whose experiment is flown where none is named.

    Raises:
        ConfigError: The experiment has mistakes.
        SafeInspectError: There are other sources than the pilot, or options that environments alone have.
    """
    overrides = [text for text in arguments.overrides if not text.startswith("address=")]
    if arguments.seed is not None:
        overrides.append(f"seed={arguments.seed}")
    experiment = _experiment(arguments.cfg, overrides, model)
    if experiment is None:
        if arguments.workers is not None:
            raise SafeInspectError(
                "--workers is for the missions of a rendezvous; an environment runs --num-envs episodes at a time"
            )
        return None
    others = [text for text in sources if text != _PILOT]
    if others:
        raise SafeInspectError(
            f"{others[0]}: a rendezvous is flown by its pilot; leave the source out, and choose the pilot's parts by "
            "KEY=VALUE, such as tracker={functor: LQRTracker}"
        )
    for given, option in (
        (arguments.record, "--record"), (arguments.reference, "--reference"), (arguments.sampled is not None, "--mode"),
        (arguments.num_envs != NUM_ENVS, "--num-envs"),
    ):  # fmt: skip
        if given:
            raise SafeInspectError(
                f"{option} is for environments, and {experiment.source} is a rendezvous; leave it out"
            )
    print_loading()
    print_doubts(check_scenario(experiment, arguments.episodes))
    arguments.seed, arguments.num_envs = experiment.config.seed, 1
    return PilotCandidate(experiment, _flights(arguments))


def _flights(arguments: argparse.Namespace) -> Flights:
    """Return what flies the missions: processes of this machine, or Ray where `address` is given."""
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
