"""Checks, initial states and policies that involve several agents."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from safe_inspect.config.building.agents import check_unique
from safe_inspect.config.loading.located import Place, path_text
from safe_inspect.config.loading.templates import MAX_COUNT
from safe_inspect.config.models import (
    ENVIRONMENT_PATH,
    AgentEntry,
    EnvironmentConfig,
    ExperimentConfig,
    PolicyConfig,
)
from safe_inspect.config.spec import AgentSpec, PolicySpec
from safe_inspect.dones.shared import CollisionDoneFunction
from safe_inspect.errors import UnsafeInitialStateWarning, did_you_mean
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.simulators.resets.plan import ResetPlan, TeamTest
from safe_inspect.types import BoolArray, FloatArray


def check_agents(config: ExperimentConfig, agents: Sequence[AgentSpec], root: Place) -> None:
    """Check names, platforms and shared done functions, and that all agents have the same frame rate.

    Args:
        config: The validated models.
        agents: The agents without mistakes.
        root: Position of the whole configuration.
    """
    controls: dict[str, str] = {}
    environment, lead = root.at(*ENVIRONMENT_PATH), config.agent_config[0]
    check_unique("agents", (entry.name for entry in config.agent_config), root.at("agent_config"))
    for index, entry in enumerate(config.agent_config):
        place = root.at("agent_config", index)
        for number, platform in enumerate(entry.platforms[:1]):
            if platform in controls:
                message = f"{controls[platform]} and {entry.name} both control the platform {platform!r}"
                place.report(f"{message}; give each agent its own platform", "platforms", number)
            controls[platform] = entry.name
        if entry.body.frame_rate != lead.body.frame_rate:
            message = f"{entry.name} acts at {entry.body.frame_rate:g} Hz, {lead.name} at {lead.body.frame_rate:g} Hz"
            place.report(f"{message}; all agents must act at the same rate", "config", "config", "frame_rate")
    if len(config.agent_config) > MAX_COUNT:
        text = f"{len(config.agent_config)} agents are too many; an environment has at most {MAX_COUNT}"
        root.report(text, "agent_config")
    done_names = {named.name for agent in agents for named in agent.dones}
    shared, place = config.environment.dones.shared, environment.at("dones", "shared")
    check_unique("shared dones", (named.name for named in shared), place)
    for index, named in enumerate(shared):
        for field, kind in named.functor.references().items():
            value = getattr(named.functor, field)
            if kind == "done" and value not in done_names and len(agents) == len(config.agent_config):
                where = path_text(place.at(index, "config", field).path)
                text = f"{where}: no agent has a done function named {value!r}, so that {named.name} never ends an "
                warnings.warn(f"{text}episode; {did_you_mean(value, done_names)}", stacklevel=2)
    safety = config.environment.rta
    if safety is None or not safety.enabled:
        return
    if config.environment.ended_deputies == "hold_thrust":
        text = "the environment's `rta` assumes that ended deputies coast; use `coast`, or disable the filter"
        environment.report(text, "ended_deputies")
    for index, agent in enumerate(agents):
        if agent.safety_filter is not None:
            text = "its safety filter and that of the environment's `rta` are both enabled; disable one of them"
            root.report(text, "agent_config", index, "config", "config", "glues")


def safe_initial_states(reset: ResetPlan, agents: Sequence[AgentSpec], environment: EnvironmentConfig) -> ResetPlan:
    """Return the plan that rejects every initial state from which the filters could not keep the deputies safe."""
    filters = {index: agent.safety_filter for index, agent in enumerate(agents) if agent.safety_filter is not None}
    lead = filters.get(0)
    if lead is not None:
        reset = replace(reset, parameters=_sampled_with(reset, lead))
    others = {index: glue.for_starts() for index, glue in filters.items() if glue != lead}
    tests: list[TeamTest] = [partial(_own_refusals, others)] if others else []
    shared = [named.functor for named in environment.dones.shared]
    collisions = [done.safety_constraint for done in shared if isinstance(done, CollisionDoneFunction)]
    watches = [
        partial(_warn_of_starts, (agents[index].platform,), glue.for_starts())
        for index, glue in filters.items()
        if not _tested(reset, agents[index].platform, by_own=index == 0)
    ]
    if environment.rta is not None and environment.rta.enabled:
        tests.append(partial(_team_refusals, environment.rta))
        names = tuple(agent.platform for agent in agents)
        if not all(_tested(reset, name, by_own=False) for name in names):
            watches.append(partial(_warn_of_starts, names, environment.rta))
    separation = max(collisions, default=0.0)
    return replace(reset, separation=separation, tests=tuple(tests), watches=tuple(watches))


def _tested(reset: ResetPlan, platform: str, *, by_own: bool) -> bool:
    """Return whether a rejection sampler tests the initial states of a deputy against the filters.

    Samplers apply the further tests of the plan; the filter of the first deputy is part of the sampler's `rta`.
    """
    samplers = [reset.parameters[name] for name in reset.deputies[platform].sources if name in reset.parameters]
    return any(isinstance(item, RejectionSampler) and (not by_own or item.rta is not None) for item in samplers)


def _warn_of_starts(
    platforms: tuple[str, ...],
    safety: SafetyGlue | TeamSafety,
    bodies: Mapping[str, Mapping[str, FloatArray]],
    values: Mapping[str, Any],
) -> None:
    """Warn about initial states from which a filter gives no guarantee; see `StartWatch`."""
    states = {name: value for name, value in values.items() if not isinstance(value, Mapping)}
    for state in ("position", "velocity"):
        own = [bodies[name][state] for name in platforms]
        states[state] = np.stack(own, axis=1) if isinstance(safety, TeamSafety) else own[0]
    refused = [name for name, rows in safety.refusals(states).items() if rows.any()]
    if refused:
        by = ", ".join(refused)
        text = f"{', '.join(platforms)}: initial states are rejected by {by}; the safety filter gives no guarantee for "
        text += "such episodes; sample them with a RejectionSampler that has an `rta`, or choose others"
        warnings.warn(text, UnsafeInitialStateWarning, stacklevel=2)


def _sampled_with(reset: ResetPlan, safety: SafetyGlue) -> dict[str, Any]:
    return {
        name: parameter.model_copy(update={"rta": parameter.rta.for_filtered(safety)})
        if isinstance(parameter, RejectionSampler) and parameter.rta is not None
        else parameter
        for name, parameter in reset.parameters.items()
    }


def _own_refusals(
    filters: Mapping[int, SafetyGlue], states: Mapping[str, FloatArray], index: int, before: Mapping[str, FloatArray]
) -> dict[str, BoolArray]:
    """Return the rejected samples of a deputy by its own filter in `filters`, if it has one there; see `TeamTest`."""
    return filters[index].refusals(states) if index in filters else {}


def _team_refusals(
    safety: TeamSafety, states: Mapping[str, FloatArray], index: int, before: Mapping[str, FloatArray]
) -> dict[str, BoolArray]:
    """Return the rejected samples of a deputy together with the deputies sampled before it; see `TeamTest`."""
    team = {
        name: np.concatenate((before[name], states[name][:, None]), axis=1) if before else states[name][:, None]
        for name in ("position", "velocity")
    }
    return safety.refusals({**states, **team})


def policies_of(config: ExperimentConfig, root: Place) -> dict[str, PolicySpec]:
    """Return the policies of the agents that the caller controls, by name, in agent order.

    Args:
        config: The validated models.
        root: Position of the whole configuration.
    """
    entries = root.at("agent_config")
    flown: dict[str, list[tuple[int, AgentEntry, PolicyConfig]]] = {}
    for index, entry in enumerate(config.agent_config):
        if entry.policy is None and len(config.agent_config) > 1:
            examples = "{algorithm: PPO} or {functor: ZeroThrust}"
            text = f"the agent {entry.name!r} has no policy; add the key `policy`, such as {examples}"
            entries.report(text, index)
        policy = entry.policy or PolicyConfig()
        if policy.functor is None:
            flown.setdefault(entry.flown_by, []).append((index, entry, policy))
        elif entry.policy_name is not None:
            entries.report("a scripted policy cannot be shared; remove the name", index, "policy_name")
    if not flown:
        entries.report("no agent has a policy that is trained; give one of them an `algorithm`")
    elif not any(policy.checkpoint is None for group in flown.values() for _, _, policy in group):
        entries.report("all policies come from checkpoints, so none is trained; give one an `algorithm`")
    found = {}
    for name, group in flown.items():
        (_, first, policy), *others = group
        for index, entry, other in others:
            if other != policy:
                text = f"{first.name} and {entry.name} share the policy {name!r}, but configure it differently"
                entries.report(text, index, "policy")
        agents = tuple(entry.name for _, entry, _ in group)
        given = policy.algorithm, dict(policy.config), policy.checkpoint, policy.policy
        found[name] = PolicySpec(name, agents, *given)
    algorithms = list(dict.fromkeys(policy.algorithm for policy in found.values() if policy.trains))
    for group in flown.values():
        for index, _, policy in group:
            if policy.algorithm and policy.algorithm != algorithms[0]:
                text = f"RLlib trains all policies with one algorithm, not with {' and '.join(algorithms)}"
                entries.report(text, index, "policy", "algorithm")
    return found
