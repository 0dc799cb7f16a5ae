from __future__ import annotations

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.environments import load_spec


@pytest.fixture(scope="session")
def spec():
    return load_spec("safe_inspect/TranslationalInspectionSeed-v0")


@pytest.fixture(scope="session")
def team():
    """Return the shipped task of three deputies."""
    return load_spec(configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml")
