from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safe_inspect.config.loading.loader import parse
from safe_inspect.config.loading.templates import MAX_COUNT, expand_templates
from safe_inspect.errors import Location

HERE = Location("command line", 0, text="a test")


def tree(agents: str, platforms: str = '[{name: "blue#", config: {mass: 1}}]'):
    return parse(f"{{config: {{}}, platform_config: {platforms}, agent_config: {agents}}}", HERE)


def names(expanded, key):
    return [entry["name"] for entry in expanded[key]]


@given(st.integers(1, MAX_COUNT))
def test_a_count_writes_out_as_many_agents_and_platforms(count):
    problems = []
    expanded = expand_templates(
        tree(f'[{{name: "blue#_ctrl", count: {count}, platforms: ["blue#"], config: A, policy: P}}]'), problems
    )
    assert not problems
    assert names(expanded, "agent_config") == [f"blue{k}_ctrl" for k in range(count)]
    assert names(expanded, "platform_config") == [f"blue{k}" for k in range(count)]
    for k, entry in enumerate(expanded["agent_config"]):
        assert entry["platforms"] == [f"blue{k}"]
        assert "count" not in entry
        assert (entry["config"], entry["policy"]) == ("A", "P")


def test_other_entries_stay_as_they_are_and_keep_their_order():
    given_tree = tree(
        '[{name: lead, platforms: [red]}, {name: "blue#_ctrl", count: 2, platforms: ["blue#"]},'
        " {name: last, platforms: [x]}]",
        '[{name: x}, {name: "blue#"}, {name: red}]',
    )
    expanded = expand_templates(given_tree, [])
    assert names(expanded, "agent_config") == ["lead", "blue0_ctrl", "blue1_ctrl", "last"]
    assert names(expanded, "platform_config") == ["x", "blue0", "blue1", "red"]
    assert names(given_tree, "agent_config")[1] == "blue#_ctrl"  # the tree itself is not changed


def test_two_templates_have_their_own_platforms():
    expanded = expand_templates(
        tree(
            '[{name: "blue#_ctrl", count: 2, platforms: ["blue#"]},'
            ' {name: "red#_ctrl", count: 1, platforms: ["red#"]}]',
            '[{name: "blue#"}, {name: "red#"}]',
        ),
        [],
    )
    assert names(expanded, "platform_config") == ["blue0", "blue1", "red0"]


@pytest.mark.parametrize(
    ("agents", "path", "words"),
    [
        ('[{name: "b#", count: 0, platforms: ["b#"]}]', "agent_config[0].count", "from 1 to"),
        ('[{name: "b#", count: true, platforms: ["b#"]}]', "agent_config[0].count", "whole number"),
        ('[{name: "b#", count: 2.5, platforms: ["b#"]}]', "agent_config[0].count", "2.5"),
        ("[{name: b, count: 2, platforms: [b]}]", "agent_config[0].count", "`#`"),
        ('[{name: "b#", count: 2, platforms: [b]}]', "agent_config[0].count", "`#`"),
        ("[{name: b, platforms: [b]}]", "platform_config[0].name", "no agent controls the platforms 'blue#'"),
    ],
)
def test_a_mistake_is_reported_with_its_place(agents, path, words):
    problems = []
    expand_templates(tree(agents), problems)
    assert path in [problem.path for problem in problems]
    assert any(words in str(problem) for problem in problems)
    assert all(problem.location is not None for problem in problems)
