"""The ids of the shipped tasks: one name means one task, with and without its filter."""

from __future__ import annotations

import gymnasium
import pytest
from gymnasium.envs.registration import find_highest_version, parse_env_id

from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import SafeInspectError
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.task_ids import ALL_TASKS


def test_an_id_means_the_task_of_its_name():
    for team, folder in (("", "translational-inspection"), ("Multiagent", "multiagent-translational-inspection")):
        assert ALL_TASKS[f"safe_inspect/{team}TranslationalInspection-v1"] == f"{folder}/experiment.yml"
        assert ALL_TASKS[f"safe_inspect/{team}TranslationalInspectionSeed-v0"] == f"{folder}/experiment-seed.yml"


@pytest.mark.parametrize("team", ["", "Multiagent"])
def test_a_former_id_names_the_present_one(team):
    former, present = (f"safe_inspect/{team}TranslationalInspection{label}" for label in ("-v0", "Seed-v0"))
    with pytest.warns(
        FutureWarning, match=f"{former} is now called {present}; use that name .version 1 is a different"
    ):
        assert load_experiment(former).resolved == load_experiment(present).resolved


def test_no_present_id_is_called_out_of_date():
    for task in ALL_TASKS:
        namespace, name, version = parse_env_id(task)
        assert find_highest_version(namespace, name) == version


@pytest.mark.parametrize(
    ("name", "filtered"),
    [
        ("TranslationalInspection-v1", False),
        ("FilteredTranslationalInspection-v1", True),
        ("MultiagentTranslationalInspection-v1", True),
        ("MultiagentTranslationalInspectionSeed-v0", False),
    ],
)
def test_the_filter_is_on_where_the_id_says_so(name, filtered):
    assert _is_filtered(load_experiment(f"safe_inspect/{name}").spec) == filtered


def _is_filtered(spec):
    glues = [glue for agent in spec.agents for glue in agent.action_glues if isinstance(glue, SafetyGlue)]
    filters = [*glues, *filter(None, [spec.team_safety])]
    return any(item.enabled for item in filters)


def test_the_id_of_a_team_names_what_makes_it():
    with pytest.raises(SafeInspectError, match="make_parallel"):
        gymnasium.make("safe_inspect/MultiagentTranslationalInspection-v1")
