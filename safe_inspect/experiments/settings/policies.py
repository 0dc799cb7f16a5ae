"""The environments and the policies of a training, as plain data that is checked before Ray is loaded."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from safe_inspect.config.elements import commanded_elements, observed_elements
from safe_inspect.config.experiment import Experiment
from safe_inspect.config.spec import AgentSpec, PolicySpec
from safe_inspect.environments.layout import Layout, action_layout, observation_layout
from safe_inspect.errors import Problem
from safe_inspect.evaluation.policy_file import PolicyInfo
from safe_inspect.experiments.settings.translation import translate_policy

#: The value of `maker` that selects this package's own environments.
DEFAULT_MAKER = ""

#: RLlib's name of the policy of a single agent.
SINGLE = "default_policy"


def environment_settings(experiment: Mapping[str, Any], rllib: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return the environment configuration for RLlib.

    The resolved experiment is stored as JSON text, because Tune would resolve any `grid_search` inside a mapping again.

    Args:
        experiment: The resolved experiment.
        rllib: Settings of the algorithm, from which the seed and the number of Torch threads are taken.
        **more: Further values of the run.
    """
    return {
        "experiment": json.dumps(experiment),
        "seed": int(rllib.get("seed") or 0),
        "torch_num_threads": rllib["torch_num_threads"],
        **more,
    }


def experiment_in(config: Mapping[str, Any]) -> Any:
    """Return the resolved experiment from RLlib's environment configuration, which contains it as JSON text."""
    experiment = config["experiment"]
    return json.loads(experiment) if isinstance(experiment, str) else experiment


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


def check_layouts(policies: Mapping[str, PolicySpec], agents: Mapping[str, AgentSpec]) -> list[Problem]:
    """Return a problem for each agent whose layouts differ from those of the first agent of the same policy."""
    problems = []
    for policy in policies.values():
        layouts = {agent: (observation_layout(agents[agent]), action_layout(agents[agent])) for agent in policy.agents}
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


def policy_info(
    experiment: Experiment, policy: str, agents: Sequence[AgentSpec], *, exportable: bool = False
) -> PolicyInfo:
    """Return the description of a policy, without the configuration and without data about its training.

    Args:
        experiment: The experiment.
        policy: Name of the policy.
        agents: The agents that it controls.
        exportable: See `observed_elements`.

    Raises:
        ConfigError: `exportable` is true and the elements cannot be exported.
    """
    layout = action_layout(agents[0])
    return PolicyInfo(
        policy=policy,
        agents=tuple(agent.name for agent in agents),
        task=str(experiment.config.config.config.env_config.TrialName),
        observation=_merged([observed_elements(agent, exportable=exportable) for agent in agents]),
        action=_merged([commanded_elements(agent, exportable=exportable) for agent in agents]),
        distribution="categorical" if layout.choices else "gaussian" if layout.coast is None else "hurdle",
        step_size=experiment.spec.step_size,
        configuration={},
    )


def _merged(layouts: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Return the elements of the first agent, each with the plugins of all agents."""
    return tuple(
        replace(first, plugins=tuple(sorted({text for element in (first, *others) for text in element.plugins})))
        for first, *others in zip(*layouts, strict=True)
    )
