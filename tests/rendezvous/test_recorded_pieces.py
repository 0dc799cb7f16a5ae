"""Results of single parts of a mission on fixed inputs match the record.

A change that is meant to change them has to update the record:

    RECORD_RENDEZVOUS=1 python -m pytest -n 0 tests/rendezvous/test_recorded_pieces.py
"""

from __future__ import annotations

from pathlib import Path

import pytest

from .pieces_of_control import PIECES as CONTROL
from .pieces_of_files import PIECES as FILES
from .pieces_of_planning import PIECES as PLANNING
from .record import check

RECORD = Path(__file__).with_name("pieces.json")
PIECES = CONTROL | FILES | PLANNING


@pytest.mark.parametrize("name", PIECES)
def test_the_results_match_the_record(name: str) -> None:
    check(RECORD, name, PIECES[name](), tolerance=None if name == "plans" else 1e-3)
