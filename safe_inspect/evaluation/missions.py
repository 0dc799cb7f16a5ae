"""`fly_missions`: runs the missions of a rendezvous, in several workers, as the episodes of an evaluation."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.episodes import AgentEpisodes, Episodes, Progress, join
from safe_inspect.evaluation.kept import KeptEpisodes
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.scenario import initial_tumbles, mission_streams
from safe_inspect.missions.summary import MISSION_FIGURES
from safe_inspect.plugins.functor import describe
from safe_inspect.rendezvous.experiment import Rendezvous, RendezvousConfig, build_rendezvous

#: Name of the agent.
_CHASER = "chaser"

#: Runs missions and yields the number and the summary of each as it ends. Its arguments are the resolved configuration,
#: the file from which it was loaded, and the numbers of the missions.
Flights = Callable[[dict[str, Any], str, Sequence[int]], Generator[tuple[int, dict[str, Any]], None, None]]


def fly_missions(
    experiment: Rendezvous,
    episodes: int,
    flights: Flights | None = None,
    kept: KeptEpisodes | None = None,
    progress: Progress | None = None,
) -> Episodes:
    """Run the missions 0 to `episodes` - 1.

    Mission k is the first episode of environment slot k: it has the same random samples.

    Args:
        experiment: The experiment, whose seed is that of the missions.
        episodes: Number of missions.
        flights: Runner of the missions; this process by default. The missions do not depend on it.
        kept: The missions of an earlier call, each as a batch of one, which are not run again; new ones are added.
        progress: Called with (finished episodes, `episodes`).
    """
    kept = kept or KeptEpisodes()
    known = {number: kept.get(number, 1) for number in range(episodes)}
    found = {number: episode for number, episode in known.items() if episode is not None}
    missing = [number for number in range(episodes) if number not in found]
    if progress is not None:
        progress(len(found), episodes)
    if not missing:
        return join([found[number] for number in range(episodes)])
    with closing((flights or LocalFlights(1))(experiment.resolved, experiment.source, missing)) as ended:
        for number, summary in ended:
            found[number] = mission_episode(experiment.config, number, summary)
            kept.add(number, found[number])
            if progress is not None:
                progress(len(found), episodes)
    return join([found[number] for number in range(episodes)])


def mission_episode(config: RendezvousConfig, number: int, summary: Mapping[str, Any]) -> Episodes:
    """Return a mission as an episode without rewards; its steps are control steps.

    Args:
        config: The experiment.
        number: Number of the mission.
        summary: Its summary, see `safe_inspect.missions.summary.summarise_mission`.
    """
    orientation, angular_velocity = initial_tumbles(config, mission_streams(config, number))
    given = {name: summary.get(name) for name in MISSION_FIGURES}
    info = {name: np.array([np.nan if value is None else value], np.float64) for name, value in given.items()}
    length = np.array([round(summary["time"] / config.mission.step)])
    status = np.array([DoneStatus.WIN if summary["success"] else DoneStatus.LOSE], np.int8)
    agent = AgentEpisodes(np.zeros(1), {}, length, status, np.array([summary["delta_v"]]), info)
    return Episodes.of(
        {_CHASER: agent},
        seed=config.seed,
        length=length,
        status=status,
        info=info,
        labels=MISSION_FIGURES,
        initial_states={
            "position": np.array(config.chaser.position)[None, None],
            "velocity": np.array(config.chaser.velocity)[None, None],
            "target_orientation": orientation,
            "target_angular_velocity": angular_velocity,
        },
        causes=np.array(["" if summary["success"] else summary["cause"]]),
    )


def mission_task(config: RendezvousConfig) -> dict[str, Any]:
    """Return the part of a rendezvous that two evaluations must share to be comparable.

    The components of the pilot and the sensors that it reads may differ.
    """
    chaser, mission = (part.model_dump(mode="json") for part in (config.chaser, config.mission))
    return {
        "rendezvous": {
            "mission": mission, "chaser": chaser, "target": describe(config.target), "tumble": describe(config.tumble),
        }
    }  # fmt: skip


def fly_mission(tree: dict[str, Any], source: str, number: int) -> tuple[int, dict[str, Any]]:
    """Run one mission and return its number and its summary.

    Args:
        tree: The resolved configuration.
        source: The file from which it was loaded.
        number: Number of the mission.
    """
    return number, Mission(build_rendezvous(tree, source).config, number).run().summary


@dataclass(frozen=True)
class LocalFlights:
    """Runner of missions in processes of this machine; a single worker is this process itself.

    Attributes:
        workers: Number of processes.
    """

    workers: int

    def __call__(
        self, tree: dict[str, Any], source: str, numbers: Sequence[int]
    ) -> Generator[tuple[int, dict[str, Any]], None, None]:
        """Run missions and yield the number and the summary of each as it ends."""
        if self.workers == 1 or len(numbers) < 2:
            for number in numbers:
                yield fly_mission(tree, source, number)
            return
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")  # each process has one core
        with ProcessPoolExecutor(self.workers, mp_context=get_context("spawn"), initializer=_end_with_parent) as pool:
            try:
                for ended in as_completed([pool.submit(fly_mission, tree, source, number) for number in numbers]):
                    yield ended.result()
            finally:
                pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """End this process when its parent is killed; otherwise it would wait for work forever."""
    parent = parent_process()
    assert parent is not None, "a worker has a parent"

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()
