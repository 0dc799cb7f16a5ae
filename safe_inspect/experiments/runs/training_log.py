"""The files that a training writes after each iteration: progress.csv, result.json and the TensorBoard log.

A resumed run continues these files: the entries that an earlier attempt logged after the checkpoint from which the run
continues are removed. (Tune's own logs start again with each attempt, count TensorBoard's steps in iterations, drop
columns that appear late, and repeat the whole configuration in each line.)
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from pathlib import Path

from safe_inspect.experiments.runs.progress import row_of
from safe_inspect.outputs import new_file

_HIDDEN = ("timestamp", "pid", "seed", "iterations_since_restore", "time_since_restore")


class TrainingLog:
    """Writer of the logs of one training.

    Args:
        folder: Folder of the files.
        iteration: The iteration from which the training continues; later rows are removed.
        steps: Number of environment steps at that iteration.
    """

    def __init__(self, folder: Path, iteration: int = 0, steps: int = 0) -> None:
        from tensorboardX import SummaryWriter  # type: ignore[import-untyped]

        folder.mkdir(parents=True, exist_ok=True)
        self._csv, self._json = folder / "progress.csv", folder / "result.json"
        self._rows = [row for row in read_progress(self._csv) if row["iteration"] <= iteration]
        self._columns = list(dict.fromkeys(column for row in self._rows for column in row))
        _keep_lines(self._json, iteration)
        self._write_rows()
        purge = steps + 1 if iteration else None
        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=purge, flush_secs=10)

    def add(self, flat: Mapping[str, float]) -> None:
        """Write the entries of an iteration, given its flattened result."""
        row = row_of(flat)
        self._rows.append(row)
        new = [column for column in row if column not in self._columns]
        self._columns += new
        if new:  # such as the reward terms, which are only known once the first episode has ended
            self._write_rows()
        else:
            with self._csv.open("a", newline="", encoding="utf-8") as file:
                csv.DictWriter(file, self._columns).writerow(_cells(row))
        with self._json.open("a", encoding="utf-8") as file:
            values = {key: value for key, value in flat.items() if math.isfinite(value)}
            file.write(json.dumps(values) + "\n")
        step = int(flat.get("num_env_steps_sampled_lifetime", 0))
        for key, value in flat.items():
            if math.isfinite(value) and key not in _HIDDEN:
                self._board.add_scalar(key if "/" in key else f"run/{key}", value, step)
        self._board.flush()

    def close(self) -> None:
        """Close the files."""
        self._board.close()

    def _write_rows(self) -> None:
        if not self._columns:
            self._csv.unlink(missing_ok=True)
            return
        with new_file(self._csv) as work, work.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self._columns)
            writer.writeheader()
            writer.writerows(_cells(row) for row in self._rows)


def read_progress(path: Path) -> list[dict[str, float]]:
    """Return the rows of a progress.csv; an empty cell is NaN, and a row that a kill has truncated is omitted."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row.get("iteration") and None not in row.values()]
    return [{key: float(cell) if cell else math.nan for key, cell in row.items() if key is not None} for row in rows]


def _cells(row: Mapping[str, float]) -> dict[str, str]:
    return {key: f"{value:.10g}" if math.isfinite(value) else "" for key, value in row.items()}


def _keep_lines(path: Path, iteration: int) -> None:
    if not path.is_file():
        return
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            if json.loads(line)["training_iteration"] <= iteration:
                kept.append(line + "\n")
        except (ValueError, KeyError):
            continue  # truncated by a kill
    with new_file(path) as work:
        work.write_text("".join(kept), encoding="utf-8")
