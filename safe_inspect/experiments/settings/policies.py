"""Settings of several policies that learn or act together, checked before Ray is loaded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from safe_inspect.config.spec import PolicySpec
from safe_inspect.environments.group import AgentGroup
from safe_inspect.environments.layout import Layout
from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.translation import translate_policy

#: RLlib's name of the policy of a single agent.
SINGLE = "default_policy"


@dataclass(frozen=True)
class PolicySettings:
    """Settings of one of several policies.

    Attributes:
        name: Its name, which is also the name of its RLlib module.
        agents: The agents that it controls.
        settings: Its own RLlib settings, which override those of all policies; `model_config` is a nested mapping.
        checkpoint: Folder of the checkpoint from which it is loaded; None if it learns.
        source_policy: Its name in that checkpoint; None if the checkpoint contains only one policy.
    """

    name: str
    agents: tuple[str, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)
    checkpoint: str | None = None
    source_policy: str | None = None

    @property
    def trains(self) -> bool:
        """Whether it learns."""
        return self.checkpoint is None


def read_policies(
    policies: Iterable[PolicySpec], algorithm: str
) -> tuple[dict[str, PolicySettings], list[str], list[Problem]]:
    """Translate the settings of each policy.

    Args:
        policies: The policies, in agent order.
        algorithm: Name of the algorithm with which all policies learn.

    Returns:
        The policies by name, and the notes and problems of the translation. All three are empty for a single agent,
        whose settings are those of the whole training.
    """
    policies = list(policies)
    found: dict[str, PolicySettings] = {}
    notes: list[str] = []
    problems: list[Problem] = []
    if sum(len(policy.agents) for policy in policies) < 2:
        return found, notes, problems
    for policy in policies:
        own = translate_policy(policy.config, policy.name, algorithm)
        notes += [note for note in own.notes if note not in notes]
        problems += own.problems
        found[policy.name] = PolicySettings(
            policy.name, policy.agents, own.settings, policy.checkpoint, policy.source_policy
        )
    return found, notes, problems


def layouts_of(groups: Sequence[AgentGroup]) -> dict[str, tuple[Layout, Layout]]:
    """Return the layouts of the observation and the action of each controlled agent (not scripted)."""
    return {
        agent: (group.observation_layout, group.action_layout)
        for group in groups
        if not group.scripted
        for agent in group.agents
    }


def check_layouts(policies: Mapping[str, PolicySettings], groups: Sequence[AgentGroup]) -> list[Problem]:
    """Return a problem for each agent whose layouts differ from those of the first agent of the same policy."""
    layouts = layouts_of(groups)
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
