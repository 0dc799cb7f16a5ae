"""`complete`: runs a baseline's episodes in batches, and continues an earlier run that was stopped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import OutputError
from safe_inspect.evaluation.baselines.flight import fly_slots
from safe_inspect.evaluation.baselines.optimiser import EFFORTS, optimise
from safe_inspect.evaluation.baselines.task import coverage_task
from safe_inspect.evaluation.policies import baseline
from safe_inspect.planning.record import Entry, Record, read_record, write_record

OPTIMISER = "optimiser"
#: Number of episodes in a batch, by the effort.
_BATCH = MappingProxyType({"quick": 32, "normal": 16, "thorough": 4})
_BATCH_OF_POLICIES = 256

#: Called with the number of finished episodes and the total number.
Progress = Callable[[int, int], None]


class UnwrittenRecordError(OutputError):
    """Error for episodes that were run but cannot be written.

    Attributes:
        record: All finished episodes, including those of earlier runs.
    """

    def __init__(self, message: str, record: Record) -> None:
        super().__init__(message)
        self.record = record


def complete(
    spec: EnvironmentSpec,
    record: Record,
    episodes: int,
    *,
    path: Path | None = None,
    force: bool = False,
    batch: int | None = None,
    progress: Progress | None = None,
) -> Record:
    """Return a record with the first episodes of the slots 0 to `episodes` - 1, and write it to a file.

    Finished episodes are stored in a file next to `path`, with ``.part`` appended to its name, from which the same call
    continues. An episode's figures depend neither on where a run was stopped nor on the batch.

    Args:
        spec: The task.
        record: The requested baseline; its entries are empty.
        episodes: Number of episodes.
        path: The file; None: nothing is written.
        force: Whether a file of another baseline is replaced; a file of another origin is never replaced.
        batch: Number of episodes in a batch.
        progress: Called with the number of finished episodes and the total number.

    Raises:
        OutputError: The file cannot be written, or belongs to another run.
        UnwrittenRecordError: The file cannot be written after episodes were run.
        SafeInspectError: The optimiser does not support the task, the baseline is unknown, or the file is of another
            origin.
    """
    if record.kind == OPTIMISER:
        coverage_task(spec)  # checked here to report an error before anything is written
    else:
        baseline(record.kind)
    known = () if path is None else _known(record, path, force)
    part = None if path is None else _part(path)
    if path is not None and len(known) >= episodes:
        return record.of(known[:episodes])
    done = list(known)
    if part is not None:
        write_record(record.of(known), part)
    size = batch or (_BATCH[record.effort] if record.effort is not None else _BATCH_OF_POLICIES)
    while len(done) < episodes:
        if progress is not None:
            progress(len(done), episodes)
        done += _fly(spec, record, min(size, episodes - len(done)), len(done))
        if part is not None:
            _write(record.of(tuple(done)), part)
    if progress is not None:
        progress(episodes, episodes)
    finished = record.of(tuple(done))
    if path is not None and part is not None:
        _write(finished, path)
        part.unlink(missing_ok=True)
    return finished


def _write(record: Record, path: Path) -> None:
    try:
        write_record(record, path)
    except OutputError as error:
        raise UnwrittenRecordError(str(error), record) from None


def _fly(spec: EnvironmentSpec, record: Record, episodes: int, first_slot: int) -> list[Entry]:
    if record.kind == OPTIMISER:
        assert record.effort is not None, "the record of an optimiser has an effort"
        return optimise(spec, episodes, record.seed, first_slot, EFFORTS[record.effort])
    flown = fly_slots(spec, baseline(record.kind), episodes, record.seed, first_slot)
    return [flown.entry(row) for row in range(episodes)]


def _part(path: Path) -> Path:
    return path.with_name(f"{path.name}.part")


def _known(record: Record, path: Path, force: bool) -> tuple[Entry, ...]:
    """Return the episodes that earlier runs have finished."""
    if path.is_dir():
        raise OutputError(f"{path}: this is a folder; give a file")
    known: tuple[Entry, ...] = ()
    for file in (path, _part(path)):
        if not file.exists():
            continue
        found = read_record(file)
        why = record.difference(found)
        if not why:
            known = max(known, found.entries, key=len)
        elif not force:
            raise OutputError(
                f"{file}: the file has another result ({why}); give another file, or --force to replace it"
            )
    return known
