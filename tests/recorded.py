"""Texts of tests, compared with those recorded in a file next to the tests.

To change the texts on purpose, write the record again and review the difference:

    RECORD_TEXTS=1 python -m pytest -n 0 tests/contract tests/evaluation
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

_NUMBER = re.compile(r"-?\d+(?:\.\d*)?(?:e[+-]?\d+)?")
_seen: dict[str, int] = {}


def assert_recorded(words: str, record: Path) -> None:
    """Compare a text with the one that a file holds for this place of the running test.

    Paths of files, lines and addresses do not count, and numbers may differ by 0.1 %.
    """
    test = os.environ["PYTEST_CURRENT_TEST"].rpartition("/")[2].rpartition(" ")[0]
    _seen[test] = _seen.get(test, 0) + 1
    key, shown = f"{test} {_seen[test]}", _told(words)
    texts = _read(record)
    if os.environ.get("RECORD_TEXTS"):
        texts[key] = shown
        record.write_text("\n".join(f"= {name}\n{texts[name]}\n" for name in sorted(texts)), encoding="utf-8")
    assert _NUMBER.sub("#", shown) == _NUMBER.sub("#", texts[key])
    found, wanted = (list(map(float, _NUMBER.findall(text))) for text in (shown, texts[key]))
    assert found == pytest.approx(wanted, rel=1e-3, abs=1e-6)


def _read(record: Path) -> dict[str, str]:
    text = record.read_text(encoding="utf-8") if record.is_file() else ""
    parts = [part.partition("\n") for part in re.split(r"^= ", text, flags=re.MULTILINE)[1:]]
    return {name: shown.rstrip("\n") for name, _, shown in parts}


def _told(words: str) -> str:
    words = re.sub(r"\((?:/|<|[A-Z]:)[^()]*?([\w-]+(?:\.py|>)):\d+: ", r"(\1: ", words)
    words = re.sub(r"0x[0-9a-f]+", "0x0", words)
    return re.sub(r"-?\d+\.\d{7,}(?:e[+-]?\d+)?", lambda found: f"{float(found[0]):.5g}", words).rstrip("\n")
