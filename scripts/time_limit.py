"""A plugin of pytest that fails tests which take longer than 12 s: those too slow without compilation."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import pytest

LIMIT = 12  # seconds


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Interrupt the call of a test after the limit."""

    def stop(*_: Any) -> None:
        raise TimeoutError(f"{item.name} takes more than {LIMIT} s")

    signal.signal(signal.SIGALRM, stop)
    signal.alarm(LIMIT)
    yield
    signal.alarm(0)
