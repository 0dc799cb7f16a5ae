"""`complete`: optimises plans and continues an earlier run; their table, and their file as a reference."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation.episodes import Progress
from safe_inspect.evaluation.optimiser import EFFORTS, coverage_task, optimise
from safe_inspect.evaluation.task import differing_keys, task_of
from safe_inspect.policies.plan_record import Entry, Record, read_record, write_record
from safe_inspect.types import FloatArray
from safe_inspect.version import __version__

OPTIMISER = "optimiser"
#: Number of episodes in a batch, after which finished episodes are stored.
_BATCH = 16


def empty_record(spec: EnvironmentSpec, seed: int, effort: str, cfg: str, overrides: Iterable[str]) -> Record:
    """Return the record of a run that has no episodes yet, for `complete`.

    Args:
        spec: The task.
        seed: Seed of the episodes.
        effort: Name of the effort.
        cfg: The experiment file or the id of the task.
        overrides: Overrides of the task.
    """
    about = {"safe_inspect": __version__, "configuration_file": cfg, "overrides": list(overrides)}
    return Record(seed, effort, task_of(spec), about)


def complete(
    spec: EnvironmentSpec,
    record: Record,
    episodes: int,
    *,
    path: Path | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Record:
    """Return a record with plans for the first episodes of the slots 0 to `episodes` - 1, and write it to a file.

    Finished episodes are stored in a file next to `path`, with ``.part`` appended to its name, from which the same call
    continues. An episode's figures do not depend on where a run was stopped.

    Args:
        spec: The task.
        record: The requested record; its entries are empty.
        episodes: Number of episodes.
        path: The file; None: nothing is written.
        force: Whether a file of another run is replaced; a file of another origin is never replaced.
        progress: Called with the number of finished episodes and the total number.

    Raises:
        OutputError: The file cannot be written, or belongs to another run.
        SafeInspectError: The optimiser does not support the task, or the file is of another origin.
    """
    coverage_task(spec)  # checked here to report an error before anything is written
    known = () if path is None else _known(record, path, force)
    if path is not None and len(known) >= episodes:
        return replace(record, entries=known[:episodes])
    record = replace(record, entries=known)
    while len(record.entries) < episodes:
        if path is not None:
            write_record(record, _part(path))
        done = len(record.entries)
        if progress is not None:
            progress(done, episodes)
        found = optimise(spec, min(_BATCH, episodes - done), record.seed, done, EFFORTS[record.effort])
        record = replace(record, entries=(*record.entries, *found))
    if progress is not None:
        progress(episodes, episodes)
    if path is not None:
        write_record(record, path)
        _part(path).unlink(missing_ok=True)
    return record


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


def baseline_table(record: Record) -> str:
    """Return a record's figures as a table: success rate, and mean, median and range of delta-v, burns and steps."""
    entries = record.entries
    won = np.array([entry.success for entry in entries])
    lines = [
        f"{OPTIMISER}, {len(entries):,} episodes of seed {record.seed}, effort {record.effort}",
        f"success   {100.0 * won.mean():6.2f} %   ({int(won.sum()):,} of {len(won):,})",
        f"inspected {np.mean([entry.inspected for entry in entries]):6.2f} points on average",
        f"{'':<14}{'mean':>9}{'median':>9}{'least':>9}{'most':>9}",
    ]
    rows: dict[str, FloatArray] = {
        "delta-v [m/s]": np.array([entry.delta_v for entry in entries]),
        "burns": np.array([entry.burns for entry in entries]),
        "steps": np.array([entry.steps for entry in entries], dtype=np.float64),
    }
    for name, values in rows.items():
        digits = 4 if name.startswith("delta") else 1
        cells = [f"{value:9.{digits}f}" for value in (values.mean(), np.median(values), values.min(), values.max())]
        lines.append(f"{name:<14}{''.join(cells)}")
    return "\n".join([*lines, *_against_the_inspector(record)])


def _against_the_inspector(record: Record) -> list[str]:
    """Return the lines that compare the plans with the inspector, for the episodes in which both succeed."""
    entries = record.entries
    missing = sum(entry.planned is None for entry in entries)
    refused = sum(entry.planned is not None and not entry.own for entry in entries)
    lines = [
        f"plans     {missing} not found; {refused} not confirmed by the simulator, or costlier than the inspector;",
        f"          the inspector's flight is used in {sum(not entry.own for entry in entries)} episodes",
    ]
    both = [(entry.delta_v, entry.inspector) for entry in entries if entry.success and entry.inspector is not None]
    if both:
        own, other = np.array(both).T
        share = f" ({100.0 * (own.mean() / other.mean() - 1.0):+.1f} %)" if other.mean() > 0.0 else ""
        lines.append(
            f"inspector {other.mean():.4f} m/s on average over {len(both):,} episodes; plans {own.mean():.4f}{share}"
        )
    return lines


def read_reference(path: Path, seed: int, episodes: int, task: Mapping[str, Any] | None = None) -> FloatArray:
    """Return the delta-v of the open-loop optimum of every episode [m/s], NaN where none was found, shape (episodes,).

    Args:
        path: A JSON file with the keys ``seed`` and ``delta_v``, a list with a number or null for each episode.
        seed: Seed of the episodes.
        episodes: Number of episodes.
        task: The task, see `task_of`; it must be that of the file if the file has one.

    Raises:
        SafeInspectError: The file is missing or damaged, has another seed or task, or has fewer episodes.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        values = [math.nan if value is None else float(value) for value in content["delta_v"]]
        of_seed = int(content["seed"])
    except OSError as error:
        raise SafeInspectError(f"{path}: the reference cannot be read ({error.strerror}); give another file") from None
    except (ValueError, KeyError, TypeError) as error:
        raise SafeInspectError(
            f'{path}: the reference is damaged ({error}); expected {{"seed": ..., "delta_v": [...]}}, as written by '
            "`safe-inspect baseline optimiser`"
        ) from None
    if of_seed != seed:
        raise SafeInspectError(f"{path}: the reference has seed {of_seed}, not {seed}; give --seed {of_seed}")
    apart = [] if task is None or "task" not in content else differing_keys(content["task"], task)
    if apart:
        raise SafeInspectError(
            f"{path}: the reference is of another task, which differs in {', '.join(apart[:3])}; compute it again with "
            "`safe-inspect baseline optimiser`"
        )
    if len(values) < episodes:
        raise SafeInspectError(
            f"{path}: the reference has {len(values)} episodes, fewer than {episodes}; give --episodes {len(values)}"
        )
    return np.array(values[:episodes])
