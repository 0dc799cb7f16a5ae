"""`policy_info`: the description of a policy that its checkpoints and policy files contain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from safe_inspect.config.experiment import Experiment, build_experiment
from safe_inspect.config.spec import AgentSpec, PolicySpec
from safe_inspect.environments.layout import action_layout
from safe_inspect.evaluation.policy_file import PolicyInfo, commanded_elements, observed_elements
from safe_inspect.experiments.settings.environments import DEFAULT_MAKER, experiment_in
from safe_inspect.experiments.settings.policies import SINGLE


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


def policy_texts(environments: Mapping[str, Any], policies: Mapping[str, PolicySpec]) -> dict[str, Mapping[str, str]]:
    """Return the metadata of each policy's `PolicyInfo`, by the policy's name.

    Args:
        environments: RLlib's environment configuration, see `environment_settings`.
        policies: The policies by name if there are several agents; empty for a single agent.

    Returns:
        The metadata; empty if the environments are not this package's own.
    """
    if environments.get("maker", DEFAULT_MAKER) != DEFAULT_MAKER:
        return {}
    experiment = build_experiment(experiment_in(environments))
    agents = [agent for agent in experiment.spec.agents if agent.scripted_policy is None]
    flown = {name: [agent for agent in agents if agent.name in policy.agents] for name, policy in policies.items()}
    return {name: policy_info(experiment, name, its).metadata() for name, its in (flown or {SINGLE: agents}).items()}


def _merged(layouts: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Return the elements of the first agent, each with the plugins of all agents."""
    return tuple(
        replace(first, plugins=tuple(sorted({text for element in (first, *others) for text in element.plugins})))
        for first, *others in zip(*layouts, strict=True)
    )
