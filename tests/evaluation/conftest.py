from __future__ import annotations

import pytest

from safe_inspect.environments import load_spec


@pytest.fixture(scope="session")
def spec():
    return load_spec("safe_inspect/TranslationalInspection-v0")
