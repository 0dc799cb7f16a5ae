"""Results of single parts of a mission on fixed inputs match the record.

A change that is meant to change them has to update the record:

    RECORD_RENDEZVOUS=1 python -m pytest -n 0 tests/rendezvous/pieces/test_recorded_pieces.py
"""

from __future__ import annotations

from pathlib import Path

import pytest

from ..record import check
from .control import PIECES as CONTROL
from .files import PIECES as FILES
from .planning import PIECES as PLANNING

RECORD = Path(__file__).with_name("pieces.json")
PIECES = CONTROL | FILES | PLANNING


@pytest.mark.parametrize("name", PIECES)
def test_the_results_match_the_record(name: str) -> None:
    check(RECORD, name, PIECES[name](), tolerance=None if name == "plans" else 1e-3)
