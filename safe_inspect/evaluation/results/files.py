"""The folder of an evaluation: `evaluation.json`, `episodes.npz` and `trajectories.npz`; and the form of NPZ files.

An NPZ file of episodes contains dataclasses, mappings and tuples of arrays, each array named by its path in them.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.errors import UNREADABLE_ARRAYS
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.evaluation.results.results import Block, Evaluation, EvaluationError
from safe_inspect.outputs import new_file
from safe_inspect.types import AnyArray

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


#: Errors that `load_packed` raises for a file that is missing or damaged.
UNREADABLE_PACKED = (*UNREADABLE_ARRAYS, TypeError)


def save_packed(path: Path, value: Any) -> None:
    """Write a value to an NPZ file.

    Its arrays are named by their paths, such as ``agents/blue0/returns``; the array ``tree`` is all else as JSON.

    Args:
        path: The file.
        value: A dataclass, or a tuple of dataclasses, with fields of arrays, mappings, tuples, numbers and texts.

    Raises:
        OSError: The file cannot be written.
    """
    arrays: dict[str, AnyArray] = {}
    tree = json.dumps(_packed(value, "", arrays))
    np.savez(path, tree=np.array(tree), **arrays)  # type: ignore[arg-type]


def load_packed(path: Path, *classes: type) -> Any:
    """Return the value that `save_packed` wrote.

    Args:
        path: The file.
        classes: Its dataclasses.

    Raises:
        UNREADABLE_PACKED: The file is missing or damaged.
    """
    with np.load(path, allow_pickle=False) as arrays:
        return _unpacked(json.loads(str(arrays["tree"])), arrays, {cls.__name__: cls for cls in classes})


def _packed(value: Any, path: str, arrays: dict[str, AnyArray]) -> Any:
    """Return a value in a form that JSON supports; its arrays are put into `arrays` and replaced by their names."""

    def within(items: Mapping[str, Any]) -> dict[str, Any]:
        return {key: _packed(item, f"{path}/{key}" if path else key, arrays) for key, item in items.items()}

    if isinstance(value, np.ndarray):
        arrays[path] = value
        return {"array": path}
    if isinstance(value, DoneStatus):
        return {"status": int(value)}
    if is_dataclass(value):
        content = {item.name: getattr(value, item.name) for item in fields(value)}
        return {"class": type(value).__name__, "fields": within(content)}
    if isinstance(value, Mapping):
        return {"mapping": within(value)}
    if isinstance(value, tuple):
        return {"tuple": list(within({str(k): item for k, item in enumerate(value)}).values())}
    return value


def _unpacked(value: Any, arrays: Mapping[str, AnyArray], classes: Mapping[str, type]) -> Any:
    """Return the value from which `_packed` made its result."""

    def within(items: Mapping[str, Any]) -> dict[str, Any]:
        return {key: _unpacked(item, arrays, classes) for key, item in items.items()}

    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    if "status" in value:
        return DoneStatus(value["status"])
    if "class" in value:
        return classes[value["class"]](**within(value["fields"]))
    if "mapping" in value:
        return within(value["mapping"])
    return tuple(_unpacked(item, arrays, classes) for item in value["tuple"])
