from __future__ import annotations

import pytest

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments import load_spec


@pytest.fixture(scope="session")
def spec() -> EnvironmentSpec:
    return load_spec("safe_inspect/TranslationalInspectionSeed-v0")
