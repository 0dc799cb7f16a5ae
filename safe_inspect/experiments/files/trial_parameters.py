"""The searched values of a trial: the file `params.json` in its folder, and the values as text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safe_inspect.errors import CheckpointError

PARAMETERS = "params.json"


def write_parameters(folder: Path, values: Mapping[str, Any], seed: int | None) -> None:
    """Write the searched values of a trial and its seed."""
    (folder / PARAMETERS).write_text(json.dumps({**values, "seed": seed}, indent=2) + "\n", encoding="utf-8")


def read_parameters(folder: Path) -> dict[str, Any]:
    """Return the searched values of a trial and its seed.

    Raises:
        CheckpointError: The values cannot be read.
    """
    try:
        return dict(json.loads((folder / PARAMETERS).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise CheckpointError(f"{folder / PARAMETERS}: the values of the trial cannot be read ({error})") from error


def trial_folders(folder: Path) -> list[Path]:
    """Return the folders of the trials of a search, given the folder of its run; empty for a run without a search."""
    return sorted(path.parent for path in folder.glob(f"trials/*/{PARAMETERS}"))


def parameters_text(parameters: Mapping[str, Any]) -> str:
    """Return values as one line, such as ``lr 0.0001, seed 3``."""
    return ", ".join(f"{key} {value_text(value)}" for key, value in parameters.items())


def value_text(value: Any) -> str:
    """Return a value as short text; for a schedule only its values, such as ``0.001 to 0.0001``."""
    if isinstance(value, list) and value and all(isinstance(pair, list) and len(pair) == 2 for pair in value):
        return " to ".join(value_text(late) for _, late in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return (value if isinstance(value, str) else json.dumps(value, default=str)).replace('"', "")
