"""Many missions of an experiment, by several workers; what is flown already is not flown again."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import ExitStack, closing
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

from safe_inspect.errors import CheckpointError
from safe_inspect.outputs import new_file, new_folder
from safe_inspect.rendezvous.experiment import Rendezvous, build_rendezvous
from safe_inspect.rendezvous.missions.folder import MISSION_NUMBER, CampaignFolder
from safe_inspect.rendezvous.missions.log import MissionLog, json_value
from safe_inspect.rendezvous.missions.mission import Mission


class FlownMission(NamedTuple):
    """A mission that has ended.

    Attributes:
        summary: Its summary with its number, of values that JSON knows.
        log: Its log if it failed; None otherwise.
    """

    summary: dict[str, Any]
    log: MissionLog | None


#: Flies missions, by their numbers, of a resolved configuration that was loaded from a file, and gives each as it ends.
Flights = Callable[[dict[str, Any], str, Sequence[int]], Generator[FlownMission, None, None]]


def fly_mission(tree: dict[str, Any], source: str, number: int) -> FlownMission:
    """Fly one mission.

    Args:
        tree: The resolved configuration.
        source: The file that it was loaded from.
        number: Number of the mission.
    """
    result = Mission(build_rendezvous(tree, source).config, number).run()
    summary: dict[str, Any] = json_value({MISSION_NUMBER: number, **result.summary})
    return FlownMission(summary, None if summary["success"] else result.log)


def fly_missions(
    experiment: Rendezvous,
    count: int,
    flights: Flights | None = None,
    folder: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Fly the missions 0 to count - 1 and return their summaries in this order.

    Args:
        experiment: The experiment.
        count: Number of missions.
        flights: Who flies them; by default this process. They are the same whoever it is.
        folder: Where each mission's summary goes as it ends, and the files of failed ones; missions whose summaries are
            there are not flown again. None for nowhere.
        progress: Called with how many of the missions that have to be flown have ended, from 0 on, and their number.

    Raises:
        OutputError: The folder holds something else, or cannot be written.
    """
    flights = flights or LocalFlights(1)
    with ExitStack() as stack:
        campaign = None if folder is None else stack.enter_context(CampaignFolder.opened(folder, experiment))
        found = {} if campaign is None else campaign.summaries()
        missing = [number for number in range(count) if number not in found]
        if not missing:
            return [found[number] for number in range(count)]
        if progress is not None:
            progress(0, len(missing))
        ended = stack.enter_context(closing(flights(experiment.resolved, experiment.source, missing)))
        for flown, mission in enumerate(ended, start=1):
            number = mission.summary[MISSION_NUMBER]
            if campaign is not None:
                if mission.log is not None:
                    with new_folder(campaign.path / f"mission_{number:04d}", "rendezvous", force=True) as own:
                        mission.log.write(own, experiment.text, mission.summary)
                campaign.add(mission.summary)
            found[number] = mission.summary
            if progress is not None:
                progress(flown, len(missing))
    return [found[number] for number in range(count)]


@dataclass(frozen=True)
class LocalFlights:
    """Flies missions in processes of this machine; one worker is this process itself.

    Attributes:
        workers: Number of processes.
    """

    workers: int

    def __call__(
        self, tree: dict[str, Any], source: str, numbers: Sequence[int]
    ) -> Generator[FlownMission, None, None]:
        """Fly missions and give each as it ends."""
        if self.workers == 1 or len(numbers) < 2:
            for number in numbers:
                yield fly_mission(tree, source, number)
            return
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")  # each process has one core
        with ProcessPoolExecutor(self.workers, mp_context=get_context("spawn"), initializer=_end_with_parent) as pool:
            pending = {pool.submit(fly_mission, tree, source, number) for number in numbers}
            try:
                while pending:
                    done, pending = wait(pending, return_when=FIRST_COMPLETED)
                    for future in done:
                        yield future.result()
            finally:
                for future in pending:
                    future.cancel()


def _end_with_parent() -> None:
    """End this process when its parent is killed; it would wait for work for ever."""
    parent = parent_process()
    assert parent is not None, "a worker has a parent"

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def write_missions(path: Path, summaries: Sequence[dict[str, Any]]) -> None:
    """Write the summaries as a table in Parquet."""
    import pyarrow as pa  # type: ignore[import-untyped]  # slow to import
    import pyarrow.parquet as pq  # type: ignore[import-untyped]

    with new_file(path) as work:
        pq.write_table(pa.Table.from_pylist(list(summaries)), work)


def read_missions(file: Path) -> list[dict[str, Any]]:
    """Return the summaries of a table that `write_missions` wrote.

    Raises:
        CheckpointError: The file is missing, damaged or empty, or another table.
    """
    import pyarrow as pa  # slow to import
    import pyarrow.parquet as pq

    try:
        summaries: list[dict[str, Any]] = pq.read_table(file).to_pylist()
    except (OSError, pa.ArrowException) as error:
        reason = str(error).partition("\n")[0]
        raise CheckpointError(f"{file}: the file cannot be read ({reason}); fly the missions again") from None
    if not summaries or not {"success", "cause", MISSION_NUMBER} <= summaries[0].keys():
        raise CheckpointError(f"{file}: no table of missions; give what `rendezvous --missions N --output` wrote")
    return summaries
