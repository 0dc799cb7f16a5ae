from __future__ import annotations

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.environments import load_spec
from safe_inspect.evaluation.rollouts.recording import record_episode
from safe_inspect.policies import RandomThrust


@pytest.fixture(scope="session")
def spec():
    return load_spec("safe_inspect/TranslationalInspection-v0")


@pytest.fixture(scope="session")
def team():
    """Return the shipped task of three deputies."""
    return load_spec(configs_root() / "multiagent-translational-inspection" / "experiment.yml")


@pytest.fixture(scope="session")
def flown(spec):
    """Return an episode that random thrust ends soon."""
    return record_episode(spec, RandomThrust(), seed=3)


@pytest.fixture(scope="session")
def flown_team(team):
    return record_episode(team, RandomThrust(), seed=3)
