"""The exact words with which the test kit refuses a plugin, compared with those on record.

A change that is meant to change the words writes the record anew; read what has changed:

    RECORD_REPORTS=1 python -m pytest -n 0 tests/contract
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest

from safe_inspect.testing import ContractError, check_plugin

RECORD = Path(__file__).with_name("reports.txt")
_NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?|-?\d+e[+-]?\d+")
_seen: dict[str, int] = {}


def breaches(plugin: Any, **kwargs: Any) -> dict[str, str]:
    """Return the broken rules of a plugin, each with its whole text, which is the one on record."""
    with pytest.raises(ContractError) as caught:
        check_plugin(plugin, **kwargs)
    assert isinstance(caught.value, AssertionError)
    found: dict[str, str] = {}
    for breach in caught.value.breaches:
        assert str(breach) in str(caught.value)
        assert breach.remedy
        found[breach.rule] = found.get(breach.rule, "") + str(breach)
    assert_recorded(str(caught.value))
    return found


def assert_recorded(words: str) -> None:
    """Compare a text with that on record for this place of the running test; numbers have three digits."""
    test = os.environ["PYTEST_CURRENT_TEST"].removeprefix("tests/contract/").rpartition(" ")[0]
    _seen[test] = _seen.get(test, 0) + 1
    key, told = f"{test} {_seen[test]}", _told(words)
    record = _read()
    if os.environ.get("RECORD_REPORTS"):
        record[key] = told
        RECORD.write_text("\n".join(f"= {name}\n{record[name]}\n" for name in sorted(record)), encoding="utf-8")
    assert told == record[key]


def _read() -> dict[str, str]:
    text = RECORD.read_text(encoding="utf-8") if RECORD.is_file() else ""
    parts = [part.partition("\n") for part in re.split(r"^= ", text, flags=re.MULTILINE)[1:]]
    return {name: told.rstrip("\n") for name, _, told in parts}


def _told(words: str) -> str:
    words = re.sub(r"\((?:/|<|[A-Z]:)[^()]*?([\w-]+(?:\.py|>)):\d+: ", r"(\1: ", words)
    words = re.sub(r"0x[0-9a-f]+", "0x0", words)
    return _NUMBER.sub(lambda found: f"{float(found[0]):.3g}", words).rstrip("\n")
