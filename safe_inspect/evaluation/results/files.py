"""The folder of an evaluation: `evaluation.json`, `episodes.parquet` and `trajectories.parquet`."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.evaluation.results.results import Evaluation, EvaluationError
from safe_inspect.outputs import new_file
from safe_inspect.types import AnyArray

_RECORD, _EPISODES, _TRAJECTORIES = "evaluation.json", "episodes.parquet", "trajectories.parquet"
_FORMAT = 1
#: Fields of a recorded episode that its metadata contain as they are.
_CONSTANTS = ("slot", "status", "deputies", "mean_motion", "in_body_axes", "camera", "docking_radius")
_KEY = b"safe_inspect"
_AXES = ("x", "y", "z")


def sha256(path: Path) -> str:
    """Return the SHA-256 hash of a file in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def trajectory_table(trajectories: Sequence[Trajectory]) -> Any:
    """Return a PyArrow table of recorded episodes.

    Columns: ``episode``, ``step``, ``deputy`` (name), ``time`` [s], ``x``, ``y``, ``z`` [m], ``vx``, ``vy``, ``vz``
    [m/s], ``ux``, ``uy``, ``uz`` (the thrust held over the step that starts there, NaN at the end [N]), for vehicles
    that turn ``mx``, ``my``, ``mz`` (the moment [N m]), ``delta_v`` [m/s], the other recorded arrays, such as
    ``sun_angle`` [rad] (``NAME/0``, ``NAME/1``, ... for several numbers), and in a task with points ``inspected``
    (number of points that the team has inspected so far) and ``inspected_own`` (number of points that the deputy was
    the first to inspect). Vectors are in Hill's frame, but thrust and moment of vehicles that turn are along body axes.
    The metadata contain the points and the times at which they were inspected.
    """
    import pyarrow  # type: ignore[import-untyped]

    parts = [_columns(trajectory) for trajectory in trajectories]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    records = [
        {
            **{name: getattr(trajectory, name) for name in _CONSTANTS},
            "arrays": {name: list(array.shape[1:]) for name, array in trajectory.arrays.items()},
            "points": trajectory.points.tolist(),
            "inspected_at": [when if np.isfinite(when) else None for when in trajectory.inspected_at.tolist()],
            "inspector": trajectory.inspector.tolist(),
        }
        for trajectory in trajectories
    ]
    table = pyarrow.table({name: pyarrow.array(values) for name, values in columns.items()})
    return table.replace_schema_metadata({_KEY: json.dumps(records).encode()})


def read_trajectories(path: str | os.PathLike[str]) -> tuple[Trajectory, ...]:
    """Return the recorded episodes of a Parquet file, or of an evaluation's folder.

    Raises:
        EvaluationError: The file is missing or damaged.
    """
    from pyarrow import ArrowException, parquet

    file = Path(path).expanduser()
    file = file / _TRAJECTORIES if file.is_dir() else file
    if not file.is_file():
        raise EvaluationError(f"{file}: there are no recorded episodes; evaluate with --record and --output")
    try:
        record = file.with_name(_RECORD)
        known = json.loads(record.read_text(encoding="utf-8"))["files"] if record.is_file() else {}
        if known.get(file.name, sha256(file)) != sha256(file):
            raise EvaluationError(f"{file}: the file was damaged or changed after it was written; evaluate again")
        table = parquet.read_table(file)
        records = json.loads(table.schema.metadata[_KEY])
        columns = {name: np.asarray(table[name].to_numpy()) for name in table.column_names}
        return tuple(_trajectory(columns, record) for record in records)
    except (OSError, ArrowException, KeyError, TypeError, ValueError) as error:
        raise EvaluationError(f"{file}: the recorded episodes are damaged ({error}); evaluate again") from None


def _columns(trajectory: Trajectory) -> dict[str, AnyArray]:
    states, deputies = trajectory.position.shape[:2]

    def each(array: AnyArray) -> AnyArray:
        return array.repeat(deputies)

    end = np.full((1, *trajectory.control.shape[1:]), np.nan)
    control = np.concatenate((trajectory.control, end))
    columns: dict[str, AnyArray] = {
        "episode": np.full(states * deputies, trajectory.slot),
        "step": each(np.arange(states)),
        "deputy": np.tile(np.array(trajectory.deputies, dtype=object), states),
        "time": each(trajectory.time),
    }
    vectors = [("", trajectory.position), ("v", trajectory.velocity), ("u", control[..., :3])]
    vectors += [("m", control[..., 3:])] if control.shape[-1] > 3 else []
    for start, array in vectors:
        columns |= {f"{start}{letter}": array[..., axis].reshape(-1) for axis, letter in enumerate(_AXES)}
    columns["delta_v"] = trajectory.delta_v.reshape(-1)
    for name, array in trajectory.arrays.items():
        flat = array.reshape(states, -1)
        columns |= {column: each(flat[:, k]) for k, column in enumerate(_columns_of(name, array.shape[1:]))}
    count = len(trajectory.points)
    if count:
        own = np.stack([trajectory.coverage_of(deputy) for deputy in range(deputies)], axis=1)
        columns["inspected"] = each(np.rint(trajectory.coverage * count).astype(np.int64))
        columns["inspected_own"] = np.rint(own * count).astype(np.int64).reshape(-1)
    return columns


def _columns_of(name: str, shape: Sequence[int]) -> list[str]:
    """Return the column names of a recorded array, given its shape without the axis of states."""
    return [f"{name}/{k}" for k in range(int(np.prod(shape)))] if shape else [name]


def _trajectory(columns: dict[str, AnyArray], record: dict[str, Any]) -> Trajectory:
    rows = columns["episode"] == record["slot"]
    deputies = len(record["deputies"])

    def vectors(start: str) -> AnyArray:
        return np.stack([columns[f"{start}{letter}"][rows] for letter in _AXES], axis=-1).reshape(-1, deputies, 3)

    def recorded(name: str, shape: Sequence[int]) -> AnyArray:
        found = [columns[column][rows][::deputies] for column in _columns_of(name, shape)]
        return np.stack(found, axis=-1).reshape(-1, *shape)

    arrays = record.get("arrays", {"sun_angle": []})  # older files contain only the sun
    when = [np.inf if time is None else time for time in record["inspected_at"]]
    return Trajectory(
        time=columns["time"][rows][::deputies],
        position=vectors(""),
        velocity=vectors("v"),
        control=np.concatenate([vectors(start) for start in "um" if f"{start}x" in columns], axis=-1)[:-1],
        delta_v=columns["delta_v"][rows].reshape(-1, deputies),
        arrays={name: recorded(name, shape) for name, shape in arrays.items()},
        points=np.array(record["points"], dtype=np.float64).reshape(-1, 3),
        inspected_at=np.array(when, dtype=np.float64),
        inspector=np.array(record["inspector"], dtype=np.int64),
        status=DoneStatus(record["status"]),
        slot=int(record["slot"]),
        deputies=tuple(record["deputies"]),
        mean_motion=float(record["mean_motion"]),
        in_body_axes=bool(record.get("in_body_axes")),
        camera=(tuple(camera[0]), camera[1]) if (camera := record.get("camera")) else None,
        docking_radius=float(record.get("docking_radius", 0.0)),  # older files have no radius
    )


def is_evaluation(path: str | os.PathLike[str]) -> bool:
    """Return whether a folder contains an evaluation."""
    return (Path(path) / _RECORD).is_file()


def write_evaluation(evaluation: Evaluation, folder: Path) -> None:
    """Write an evaluation to a folder.

    Raises:
        OSError: The folder cannot be written.
    """
    import pyarrow  # type: ignore[import-untyped]
    from pyarrow import parquet

    content = {
        "format": _FORMAT,
        **evaluation.record,
        "label": evaluation.label,
        "units": dict(evaluation.units),
        **evaluation.as_dict(),
    }
    folder.mkdir(exist_ok=True)
    table = pyarrow.table({name: pyarrow.array(values) for name, values in evaluation.columns().items()})
    parquet.write_table(table, folder / _EPISODES, compression="zstd")
    if evaluation.trajectories:
        parquet.write_table(trajectory_table(evaluation.trajectories), folder / _TRAJECTORIES, compression="zstd")
    content["files"] = {name: sha256(folder / name) for name in (_EPISODES, _TRAJECTORIES) if (folder / name).exists()}
    write_json(folder / _RECORD, content)


def read_evaluation(path: str | os.PathLike[str]) -> Evaluation:
    """Return the evaluation of a folder, without its trajectories.

    Raises:
        EvaluationError: The evaluation is missing or damaged.
    """
    from pyarrow import ArrowException, parquet

    folder = Path(path).expanduser()
    record = read_evaluation_record(folder)
    file = folder / _EPISODES
    try:
        if sha256(file) != record["files"].get(_EPISODES):
            raise EvaluationError(f"{file}: the file was damaged or changed after it was written; evaluate again")
        table = parquet.read_table(file)
    except (OSError, ArrowException, AttributeError) as error:
        raise EvaluationError(f"{file}: the file cannot be read ({error}); evaluate again") from None
    columns = {name: np.asarray(table[name].to_numpy()) for name in table.column_names}
    try:
        return Evaluation.of_columns(str(record.get("label") or folder.name), columns, record["units"], record)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise EvaluationError(f"{file}: the table of episodes is damaged ({error})") from None


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
        for key in ("seed", "episodes", "task", "units", "files"):
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
