"""Missions of a rendezvous as tasks of Ray, on this machine or on a cluster."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

from safe_inspect.evaluation.rollouts.missions import fly_mission
from safe_inspect.experiments.runs.cluster import ray_cluster, set_environment
from safe_inspect.experiments.settings.translation import translate_ray


@dataclass(frozen=True)
class RayFlights:
    """Flies missions as tasks of Ray, which claim one processor each.

    Only the process that started them writes files: the nodes of a cluster need no common disk, but this package.

    Attributes:
        address: ``auto`` or the address of a cluster that runs, which is joined; ``local`` starts one here.
        workers: How many missions are flown at a time.
    """

    address: str
    workers: int

    def __call__(
        self, tree: dict[str, Any], source: str, numbers: Sequence[int]
    ) -> Generator[tuple[int, dict[str, Any]], None, None]:
        """Fly missions and give each as it ends.

        Raises:
            ConfigError: The cluster cannot be reached.
        """
        set_environment()
        import ray  # slow to import

        settings = translate_ray({"address": self.address, "num_cpus": self.workers}).settings
        with ray_cluster(settings, 1.0, None):
            fly = ray.remote(num_cpus=1)(fly_mission)
            shared = ray.put(tree)
            missing = list(reversed(numbers))
            flying: list[Any] = []
            try:
                while missing or flying:
                    while missing and len(flying) < self.workers:
                        flying.append(fly.remote(shared, source, missing.pop()))
                    done, flying = ray.wait(flying)
                    yield _result(done[0])
            finally:
                for task in flying:
                    ray.cancel(task, force=True)


def _result(task: Any) -> tuple[int, dict[str, Any]]:
    import ray

    try:
        flown: tuple[int, dict[str, Any]] = ray.get(task)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None  # without the traceback of the worker
    return flown
