"""NPZ files of episodes: dataclasses, mappings and tuples of arrays, each array named by its path in them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.errors import UNREADABLE_ARRAYS
from safe_inspect.types import AnyArray

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
