"""The folder of an evaluation: `evaluation.json`, `episodes.npz` and `trajectories.npz`."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.evaluation.results.packing import UNREADABLE_PACKED, load_packed, save_packed
from safe_inspect.evaluation.results.results import Block, Evaluation, EvaluationError
from safe_inspect.outputs import new_file

#: Names of the files.
_RECORD, EPISODES, TRAJECTORIES = "evaluation.json", "episodes.npz", "trajectories.npz"
_FORMAT = 2


def sha256(path: Path) -> str:
    """Return the SHA-256 hash of a file in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_trajectories(path: str | os.PathLike[str]) -> tuple[Trajectory, ...]:
    """Return the recorded episodes of a file, or of an evaluation's folder.

    Raises:
        EvaluationError: The file is missing or damaged.
    """
    file = Path(path).expanduser()
    file = file / TRAJECTORIES if file.is_dir() else file
    if not file.is_file():
        raise EvaluationError(f"{file}: there are no recorded episodes; evaluate with --record and --output")
    record = read_evaluation_record(file.parent) if is_evaluation(file.parent) else {}
    found: tuple[Trajectory, ...] = _read(file, record, Trajectory)
    return found


def _read(file: Path, record: Mapping[str, Any], *classes: type) -> Any:
    """Return the content of a file of an evaluation.

    Raises:
        EvaluationError: The file is missing or damaged, or is not the one that was written with the record.
    """
    try:
        if record and record["files"].get(file.name) != sha256(file):
            raise EvaluationError(f"{file}: the file was damaged or changed after it was written; evaluate again")
        return load_packed(file, *classes)
    except (*UNREADABLE_PACKED, AttributeError) as error:
        raise EvaluationError(f"{file}: the file cannot be read ({error}); evaluate again") from None


def is_evaluation(path: str | os.PathLike[str]) -> bool:
    """Return whether a folder contains an evaluation."""
    return (Path(path) / _RECORD).is_file()


def write_evaluation(evaluation: Evaluation, folder: Path) -> None:
    """Write an evaluation to a folder.

    Raises:
        OSError: The folder cannot be written.
    """
    folder.mkdir(exist_ok=True)
    save_packed(folder / EPISODES, replace(evaluation, record={}, trajectories=()))
    if evaluation.trajectories:
        save_packed(folder / TRAJECTORIES, tuple(evaluation.trajectories))
    content = {
        "format": _FORMAT,
        **evaluation.record,
        "label": evaluation.label,
        **evaluation.as_dict(),
        "files": {name: sha256(folder / name) for name in (EPISODES, TRAJECTORIES) if (folder / name).exists()},
    }
    write_json(folder / _RECORD, content)


def read_evaluation(path: str | os.PathLike[str]) -> Evaluation:
    """Return the evaluation of a folder, without its trajectories.

    Raises:
        EvaluationError: The evaluation is missing or damaged.
    """
    folder = Path(path).expanduser()
    record = read_evaluation_record(folder)
    found: Evaluation = _read(folder / EPISODES, record, Evaluation, Block)
    return replace(found, record=record)


def read_evaluation_record(folder: Path) -> Mapping[str, Any]:
    """Return the content of `evaluation.json`.

    Raises:
        EvaluationError: The file is missing or damaged.
    """
    path = folder / _RECORD
    try:
        record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if record["format"] != _FORMAT:
            raise EvaluationError(f"{path}: the file was written by another version of safe_inspect; evaluate again")
        for key in ("seed", "episodes", "task", "files"):
            record[key]
    except (FileNotFoundError, NotADirectoryError):
        raise EvaluationError(
            f"{folder}: not an evaluation; give a folder that `safe-inspect evaluate --output` has written"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EvaluationError(f"{path}: the record of the evaluation is damaged ({error}); evaluate again") from None
    return record


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file.

    Raises:
        OutputError: The file cannot be written.
    """
    with new_file(path) as work:
        work.write_text(json.dumps(content, indent=1, allow_nan=False, default=str) + "\n", encoding="utf-8")
