"""`recipes_of`: which training runs differ in their seed alone."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.run_folder import RunFolder, digest, read_record

_DATE = re.compile(r"_\d{4}-\d{2}-\d{2}_\d{2}-\d{2}-\d{2}(_\d+)?$")
_TOLD = 3  # keys in a label


def progress_files(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the ``progress.csv`` of a run, or those of its trials where it has several.

    Raises:
        SafeInspectError: There is none.
    """
    path = Path(folder).expanduser()
    if path.is_file():
        return [path]
    own = RunFolder(path).progress
    found = [own] if own.is_file() else sorted(path.glob("trials/*/progress.csv"))
    if not found:
        what = "there is no such folder" if not path.exists() else "no progress.csv is in this folder"
        raise SafeInspectError(f"{os.fspath(folder)}: {what}; give the folder of a training run")
    return found


def recipes_of(folders: Sequence[str | os.PathLike[str]], labels: Sequence[str] = ()) -> dict[str, list[Path]]:
    """Return the learning curves of runs by recipe: runs that differ in nothing but their seed are one recipe.

    Args:
        folders: The runs' folders.
        labels: A label for each run (equal labels make one recipe), or one for each recipe in the order in which they
            are first met. Unless given, a recipe is named by the values in which it differs from the others.

    Raises:
        SafeInspectError: A folder is no run's, or there are neither as many labels as runs nor as recipes.
    """
    files = [progress_files(folder) for folder in folders]
    if labels and len(labels) == len(folders):
        return _together(zip(labels, files, strict=True))
    configurations = [_configuration(Path(folder).expanduser()) for folder in folders]
    keys = [digest(configuration) for configuration in configurations]
    found = _together(zip(keys, files, strict=True))
    first = [keys.index(key) for key in found]
    if labels and len(labels) != len(found):
        raise SafeInspectError(
            f"{len(labels)} labels are given for {len(folders)} runs of {len(found)} recipes; give a label for each "
            "run or for each recipe"
        )
    names = list(labels) or _names(
        [configurations[index] for index in first], [Path(folders[index]) for index in first]
    )
    return _together(zip(names, found.values(), strict=True))


def _together(pairs: Iterable[tuple[str, list[Path]]]) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for key, paths in pairs:
        found.setdefault(key, []).extend(paths)
    return found


def _configuration(folder: Path) -> Mapping[str, Any]:
    """Return what decides a run's result, its seed left out; without a record, the folder's name without its date."""
    run = RunFolder(folder)
    if not run.record.is_file():
        return {"name": _stem(folder)}
    configuration: Mapping[str, Any] = _without_seed(read_record(run)["configuration"])
    return configuration


def _stem(folder: Path) -> str:
    return _DATE.sub("", folder.resolve().parent.name if folder.is_file() else folder.resolve().name)


def _without_seed(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_seed(item) for key, item in value.items() if key != "seed"}
    return [_without_seed(item) for item in value] if isinstance(value, list) else value


def _names(configurations: Sequence[Mapping[str, Any]], folders: Sequence[Path]) -> list[str]:
    """Return the values in which each recipe differs from the others; of many differences, the folders' names."""
    flat = [dict(_leaves(configuration)) for configuration in configurations]
    keys = list(dict.fromkeys(key for leaves in flat for key in leaves))
    differing = [key for key in keys if len({leaves.get(key) for leaves in flat}) > 1]
    names = [
        ", ".join(f"{key.rpartition('.')[2]} {leaves.get(key, 'none')}".replace('"', "") for key in differing)
        for leaves in flat
    ]
    if 0 < len(differing) <= _TOLD and all(len(name) < 60 for name in names) and len(set(names)) == len(names):
        return names
    stems = [_stem(folder) for folder in folders]
    if len(set(stems)) == len(stems):
        return stems
    full = [folder.resolve().name for folder in folders]
    if len(set(full)) == len(full):
        return full
    return [f"{name} {number}" for number, name in enumerate(full, 1)]


def _leaves(value: Any, path: str = "") -> Iterable[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(item, (Mapping, list)) for item in value):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{path}[{index}]")
    else:
        yield path, json.dumps(value, default=str)
