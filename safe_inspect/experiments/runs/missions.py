"""Rendezvous missions as Ray tasks, on this machine or on a cluster."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

from safe_inspect.evaluation.missions import fly_mission
from safe_inspect.experiments.runs.cluster import ray_cluster, set_environment
from safe_inspect.experiments.settings.translation import translate_ray


@dataclass(frozen=True)
class RayFlights:
    """Runner of missions as Ray tasks, each of which uses one processor.

    Only the process that started the tasks writes files. The nodes of a cluster need this package, but no shared disk.

    Attributes:
        address: ``auto`` or the address of a running cluster to join; ``local`` starts Ray on this machine.
        workers: Number of missions that run at the same time.
    """

    address: str
    workers: int

    def __call__(
        self, tree: dict[str, Any], source: str, numbers: Sequence[int]
    ) -> Generator[tuple[int, dict[str, Any]], None, None]:
        """Run missions and yield the number and the result of each as it ends.

        Args:
            tree: The resolved configuration of the missions.
            source: The file from which the configuration was loaded.
            numbers: The numbers of the missions.

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
        raise error.cause from None  # omits the traceback of the worker
    return flown
