"""What voids the guarantee of a team's filter in the settings of the environment and of its agents is refused."""

from __future__ import annotations

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import ConfigError

_OWN = "RTAGlueCWHInspection1v1.config.enabled"
_TEAM = "config.config.env_config.rta.config.enabled"
_HELD = "config.config.env_config.ended_deputies=hold_thrust"


def _problems(*overrides: str) -> list[tuple[str, str]]:
    """Return path and message of every mistake in the shipped task of three deputies, whose own filters are off."""
    path = configs_root() / "multiagent-translational-inspection" / "experiment.yml"
    try:
        load_experiment(path, overrides).spec  # noqa: B018
    except ConfigError as error:
        return [(problem.path, problem.message) for problem in error.problems]
    return []


def test_a_thrust_held_after_the_end_is_refused_where_the_team_is_filtered() -> None:
    ((key, message),) = _problems(f"{_TEAM}=True", _HELD)
    assert key == "config.config.env_config.ended_deputies"
    assert "`rta` assumes that ended deputies coast; use `coast`, or disable the filter" in message
    assert _problems(f"{_TEAM}=False", _HELD) == []
    assert _problems(f"{_TEAM}=True", "config.config.env_config.ended_deputies=coast") == []


def test_a_filter_of_the_team_and_one_of_an_agent_are_refused() -> None:
    ((key, message),) = _problems(f"{_TEAM}=True", f"{_OWN}=True")  # the three agents share the file's line
    assert key == "agent_config[0].config.config.glues"
    assert "its safety filter and that of the environment's `rta` are both enabled; disable one of them" in message


@pytest.mark.parametrize(("team", "own"), [(True, False), (False, True), (False, False)])
def test_one_filter_or_none_is_accepted(team: bool, own: bool) -> None:
    assert _problems(f"{_TEAM}={team}", f"{_OWN}={own}") == []


def test_two_shared_dones_of_one_name_are_refused_where_the_second_is() -> None:
    shared = "config.config.env_config.dones.shared"
    done = "{functor: SetAllDoneFunction, name: everything}"
    ((key, message),) = _problems(f"{shared}=[{done}, {done}]")
    assert key == f"{shared}[1]"
    assert "two shared dones are named 'everything'; give one of them a unique `name`" in message
