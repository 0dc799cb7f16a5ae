"""The complete tables of the keys of RLlib, Tune and Ray: what each key takes, and which old names mean it.
The order of a table has no meaning.

A table that is changed on purpose is recorded again by

    RECORD_KEYS=1 python -m pytest -n 0 tests/config/test_key_tables.py
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from safe_inspect.config.keys import old_keys, rllib_keys, run_keys
from safe_inspect.config.keys.rllib_keys import Key

RECORD = Path(__file__).with_name("key_tables.txt")
MODULES = (rllib_keys, run_keys, old_keys)


def _shown(value: Any) -> str:
    if not isinstance(value, Key):
        return repr(value)
    given = {field.name: getattr(value, field.name) for field in dataclasses.fields(Key)}
    default = Key("")
    shown = [f"{name}={one!r}" for name, one in given.items() if name != "kind" and one != getattr(default, name)]
    return " ".join([value.kind, *shown])


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
