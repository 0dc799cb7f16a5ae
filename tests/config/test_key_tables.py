"""The complete tables of the keys of RLlib, Tune and Ray: what each key takes, and which old names mean it.
The order of a table has no meaning.

A table that is changed on purpose is recorded again by

    RECORD_KEYS=1 python -m pytest -n 0 tests/config/test_key_tables.py
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pydantic import TypeAdapter

from safe_inspect.config.keys import old_keys, rllib_keys, run_keys

RECORD = Path(__file__).with_name("key_tables.txt")
MODULES = (rllib_keys, run_keys, old_keys)


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(sorted(value))
    if isinstance(value, str | tuple | list | bool | int | float):
        return repr(value)
    return json.dumps(TypeAdapter(value).json_schema(), sort_keys=True)


def _lines(module: ModuleType) -> Iterator[str]:
    """Yield a line for each entry of each table of a module."""
    for name, value in vars(module).items():
        if not name.isupper() or name.startswith("_"):
            continue
        if isinstance(value, Mapping):
            yield from (f"{name} {key}: {_shown(one)}" for key, one in value.items())
        elif isinstance(value, tuple | frozenset):
            yield f"{name}: {', '.join(sorted(value) if isinstance(value, frozenset) else value)}"


def test_the_tables_are_those_of_the_record() -> None:
    lines = sorted(line for module in MODULES for line in _lines(module))
    if os.environ.get("RECORD_KEYS"):
        RECORD.write_text("\n".join(lines) + "\n", encoding="utf-8")
        pytest.skip("recorded")
    assert lines == sorted(RECORD.read_text(encoding="utf-8").splitlines())
