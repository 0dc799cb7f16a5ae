"""The folder of an evaluation: `evaluation.json`, `episodes.parquet` and `trajectories.parquet`."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.evaluation.results.hashes import sha256
from safe_inspect.evaluation.results.results import Evaluation, EvaluationError
from safe_inspect.evaluation.results.trajectory_table import RECORD, TRAJECTORIES, trajectory_table
from safe_inspect.outputs import new_file
from safe_inspect.types import AnyArray

EVALUATION_FORMAT = 1
EPISODES = "episodes.parquet"


def is_evaluation(path: str | os.PathLike[str]) -> bool:
    """Return whether a folder contains an evaluation."""
    return (Path(path) / RECORD).is_file()


def write_evaluation(evaluation: Evaluation, folder: Path) -> None:
    """Write an evaluation to a folder.

    Raises:
        OSError: The folder cannot be written.
    """
    import pyarrow  # type: ignore[import-untyped]
    from pyarrow import parquet

    content = {
        "format": EVALUATION_FORMAT,
        **evaluation.record,
        "label": evaluation.label,
        "units": dict(evaluation.units),
        **evaluation.as_dict(),
    }
    folder.mkdir(exist_ok=True)
    table = pyarrow.table({name: pyarrow.array(values) for name, values in evaluation.columns().items()})
    parquet.write_table(table, folder / EPISODES, compression="zstd")
    if evaluation.trajectories:
        parquet.write_table(trajectory_table(evaluation.trajectories), folder / TRAJECTORIES, compression="zstd")
    content["files"] = {name: sha256(folder / name) for name in (EPISODES, TRAJECTORIES) if (folder / name).exists()}
    write_json(folder / RECORD, content)


def read_evaluation(path: str | os.PathLike[str]) -> Evaluation:
    """Return the evaluation of a folder, without its trajectories.

    Raises:
        EvaluationError: The evaluation is missing or damaged.
    """
    folder = Path(path).expanduser()
    record = read_evaluation_record(folder)
    table = _read_table(folder, record)
    label = str(record.get("label") or folder.name)
    try:
        return Evaluation.of_columns(label, table, record["units"], record)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise EvaluationError(f"{folder / EPISODES}: the table of episodes is damaged ({error})") from None


def read_evaluation_record(folder: Path) -> Mapping[str, Any]:
    """Return the content of `evaluation.json`.

    Raises:
        EvaluationError: The file is missing or damaged.
    """
    path = folder / RECORD
    try:
        record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if record["format"] != EVALUATION_FORMAT:
            raise EvaluationError(f"{path}: the file was written by another version of safe_inspect; evaluate again")
        for key in ("seed", "episodes", "task", "units", "files"):
            record[key]
    except (FileNotFoundError, NotADirectoryError):
        raise EvaluationError(
            f"{folder}: not an evaluation; give a folder that `safe-inspect evaluate --output` has written"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EvaluationError(f"{path}: the record of the evaluation is damaged ({error}); evaluate again") from None
    return record


def _read_table(folder: Path, record: Mapping[str, Any]) -> dict[str, AnyArray]:
    from pyarrow import ArrowException, parquet

    path = folder / EPISODES
    try:
        if sha256(path) != record["files"].get(EPISODES):
            raise EvaluationError(f"{path}: the file was damaged or changed after it was written; evaluate again")
        table = parquet.read_table(path)
    except (OSError, ArrowException, AttributeError) as error:
        raise EvaluationError(f"{path}: the file cannot be read ({error}); evaluate again") from None
    return {name: np.asarray(table[name].to_numpy()) for name in table.column_names}


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file.

    Raises:
        OutputError: The file cannot be written.
    """
    with new_file(path) as work:
        work.write_text(json.dumps(content, indent=1, allow_nan=False, default=str) + "\n", encoding="utf-8")
