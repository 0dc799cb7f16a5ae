"""The exact words with which the test kit refuses a plugin, compared with those on record."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from safe_inspect.testing import ContractError, check_plugin

from .. import recorded

RECORD = Path(__file__).with_name("reports.txt")


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
    """Compare a text with the one on record for this place of the running test."""
    recorded.assert_recorded(words, RECORD)
