"""The options of plugins, files and commands, their defaults and their ranges are as recorded: none changes unnoticed.

python tests/golden/record.py options
"""

from __future__ import annotations

from pathlib import Path

from .options import lines


def test_options_are_as_recorded():
    recorded = Path(__file__).with_name("options.txt").read_text(encoding="utf-8").splitlines()
    found = lines()
    assert [line for line in found if line not in set(recorded)] == []
    assert [line for line in recorded if line not in set(found)] == []
