"""Settings of several policies that learn or act together, checked before Ray is loaded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from safe_inspect.config.spec import PolicySpec
from safe_inspect.environments.group import AgentGroup
from safe_inspect.environments.layout import Layout
from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.translation import translate_policy

#: RLlib's name of the policy of a single agent.
SINGLE = "default_policy"


def read_policies(
    policies: Iterable[PolicySpec], algorithm: str
) -> tuple[dict[str, PolicySpec], list[str], list[Problem]]:
    """Translate the settings of each policy.

    Args:
        policies: The policies, in agent order.
        algorithm: Name of the algorithm with which all policies learn.

    Returns:
        The policies by name, each with its translated settings as `config`, and the notes and problems of the
        translation. All three are empty for a single agent, whose settings are those of the whole training.
    """
    policies = list(policies)
    found: dict[str, PolicySpec] = {}
    notes: list[str] = []
    problems: list[Problem] = []
    if sum(len(policy.agents) for policy in policies) < 2:
        return found, notes, problems
    for policy in policies:
        own = translate_policy(policy.config, policy.name, algorithm)
        notes += [note for note in own.notes if note not in notes]
        problems += own.problems
        found[policy.name] = replace(policy, config=own.settings)
    return found, notes, problems


def check_layouts(policies: Mapping[str, PolicySpec], groups: Sequence[AgentGroup]) -> list[Problem]:
    """Return a problem for each agent whose layouts differ from those of the first agent of the same policy."""
    layouts = {
        agent: (group.observation_layout, group.action_layout)
        for group in groups
        if not group.scripted
        for agent in group.agents
    }
    problems = []
    for policy in policies.values():
        first, *others = policy.agents
        for agent in others:
            for what, mine, its in zip(("observation", "action"), layouts[first], layouts[agent], strict=True):
                if not _same(mine, its):
                    message = (
                        f"{first} and {agent} share the policy {policy.name}, but their {what}s differ: "
                        f"{mine.size} and {its.size} elements{_difference(mine, its)}"
                    )
                    hint = "give them the same glues, or give each its own policy"
                    problems.append(Problem(message, f"policies.{policy.name}", hint=hint))
    return problems


def _same(first: Layout, second: Layout) -> bool:
    bounds = ((first.low, second.low), (first.high, second.high))
    return first.names == second.names and all(np.array_equal(mine, its) for mine, its in bounds)


def _difference(first: Layout, second: Layout) -> str:
    for mine, its in zip(first.names, second.names, strict=False):
        if mine != its:
            return f", such as {mine} and {its}"
    return "" if first.size != second.size else " with other bounds"
