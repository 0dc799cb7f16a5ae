"""Checks, initial states and policies that involve several agents."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from safe_inspect.config.building.agents import check_unique
from safe_inspect.config.loading.located import path_text
from safe_inspect.config.loading.templates import MAX_COUNT
from safe_inspect.config.messages.report import ENVIRONMENT_PATH, KeyTuple, ReportProblem
from safe_inspect.config.models.experiment import AgentEntry, EnvironmentConfig, ExperimentConfig, PolicyConfig
from safe_inspect.config.spec import AgentSpec, PolicySpec
from safe_inspect.dones.shared import CollisionDoneFunction
from safe_inspect.errors import UnsafeInitialStateWarning, did_you_mean
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.simulators.resets.plan import ResetPlan, TeamTest
from safe_inspect.types import BoolArray, FloatArray


def check_agents(config: ExperimentConfig, agents: Sequence[AgentSpec], report: ReportProblem) -> None:
    """Check names, platforms and shared done functions, and that all agents have the same frame rate.

    Args:
        config: The validated models.
        agents: The agents without mistakes.
        report: Function that is called with the path and the message of every mistake.
    """
    names: dict[str, int] = {}
    controls: dict[str, str] = {}
    lead = config.agent_config[0]
    for index, entry in enumerate(config.agent_config):
        where: KeyTuple = ("agent_config", index)
        if entry.name in names:
            report((*where, "name"), f"two agents are named {entry.name!r}; give each a unique name")
        names[entry.name] = index
        for number, platform in enumerate(entry.platforms[:1]):
            if platform in controls:
                message = f"{controls[platform]} and {entry.name} both control the platform {platform!r}"
                report((*where, "platforms", number), f"{message}; give each agent its own platform")
            controls[platform] = entry.name
        if entry.body.frame_rate != lead.body.frame_rate:
            message = f"{entry.name} acts at {entry.body.frame_rate:g} Hz, {lead.name} at "
            place = (*where, "config", "config", "frame_rate")
            report(place, f"{message}{lead.body.frame_rate:g} Hz; all agents must act at the same rate")
    if len(config.agent_config) > MAX_COUNT:
        text = f"{len(config.agent_config)} agents are too many; an environment has at most {MAX_COUNT}"
        report(("agent_config",), text)
    done_names = {named.name for agent in agents for named in agent.dones}
    shared = config.environment.dones.shared
    check_unique("shared dones", (named.name for named in shared), (*ENVIRONMENT_PATH, "dones", "shared"), report)
    for index, named in enumerate(shared):
        where = (*ENVIRONMENT_PATH, "dones", "shared", index)
        for field, kind in named.functor.references().items():
            value = getattr(named.functor, field)
            if kind == "done" and value not in done_names and len(agents) == len(config.agent_config):
                warnings.warn(
                    f"{path_text((*where, 'config', field))}: no agent has a done function named {value!r}, so that "
                    f"{named.name} never ends an episode; {did_you_mean(value, done_names)}",
                    stacklevel=2,
                )
    safety = config.environment.rta
    if safety is not None and safety.enabled and config.environment.ended_deputies == "hold_thrust":
        message = "the environment's `rta` assumes that ended deputies coast; use `coast`, or disable the filter"
        report((*ENVIRONMENT_PATH, "ended_deputies"), message)
    for index, agent in enumerate(agents):
        own = [glue for glue in agent.action_glues if isinstance(glue, SafetyGlue) and glue.enabled]
        if safety is not None and safety.enabled and own:
            message = "its safety filter and that of the environment's `rta` are both enabled; disable one of them"
            report(("agent_config", index, "config", "config", "glues"), message)


def safe_initial_states(reset: ResetPlan, agents: Sequence[AgentSpec], environment: EnvironmentConfig) -> ResetPlan:
    """Return the plan that rejects every initial state from which the filters could not keep the deputies safe."""
    filters = {
        index: glue
        for index, agent in enumerate(agents)
        for glue in agent.action_glues
        if isinstance(glue, SafetyGlue) and glue.enabled
    }
    lead = filters.get(0)
    if lead is not None:
        reset = replace(reset, parameters=_sampled_with(reset, lead))
    tests: list[TeamTest] = []
    others = {index: glue.for_starts() for index, glue in filters.items() if glue != lead}
    if others:
        tests.append(partial(_own_refusals, others))
    if environment.rta is not None and environment.rta.enabled:
        tests.append(partial(_team_refusals, environment.rta))
    collisions = [
        named.functor.safety_constraint
        for named in environment.dones.shared
        if isinstance(named.functor, CollisionDoneFunction)
    ]
    watches = [
        partial(_warn_of_starts, (agents[index].platform,), glue.for_starts())
        for index, glue in filters.items()
        if not _tested(reset, agents[index].platform, by_own=index == 0)
    ]
    if environment.rta is not None and environment.rta.enabled:
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
        warnings.warn(
            f"{', '.join(platforms)}: initial states are rejected by {', '.join(refused)}; the safety filter gives no "
            f"guarantee for such episodes; sample them with a RejectionSampler that has an `rta`, or choose others",
            UnsafeInitialStateWarning,
            stacklevel=2,
        )


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


def policies_of(config: ExperimentConfig, report: ReportProblem) -> dict[str, PolicySpec]:
    """Return the policies of the agents that the caller controls, by name, in agent order.

    Args:
        config: The validated models.
        report: Function that is called with the path and the message of every mistake.
    """
    flown: dict[str, list[tuple[int, AgentEntry, PolicyConfig]]] = {}
    for index, entry in enumerate(config.agent_config):
        if entry.policy is None and len(config.agent_config) > 1:
            examples = "{algorithm: PPO} or {functor: ZeroThrust}"
            text = f"the agent {entry.name!r} has no policy; add the key `policy`, such as {examples}"
            report(("agent_config", index), text)
        policy = entry.policy or PolicyConfig()
        if policy.functor is None:
            flown.setdefault(entry.flown_by, []).append((index, entry, policy))
        elif entry.policy_name is not None:
            where = ("agent_config", index, "policy_name")
            report(where, "a scripted policy cannot be shared; remove the name")
    if not flown:
        report(("agent_config",), "no agent has a policy that is trained; give one of them an `algorithm`")
    elif not any(policy.checkpoint is None for group in flown.values() for _, _, policy in group):
        report(("agent_config",), "all policies come from checkpoints, so none is trained; give one an `algorithm`")
    found = {}
    for name, group in flown.items():
        _check_shared(name, group, report)
        policy = group[0][2]
        found[name] = PolicySpec(
            name,
            tuple(entry.name for _, entry, _ in group),
            policy.algorithm,
            dict(policy.config),
            policy.checkpoint,
            policy.policy,
        )
    algorithms = list(dict.fromkeys(policy.algorithm for policy in found.values() if policy.trains))
    for group in flown.values():
        for index, _, policy in group:
            if policy.algorithm and policy.algorithm != algorithms[0]:
                place: KeyTuple = ("agent_config", index, "policy", "algorithm")
                report(place, f"RLlib trains all policies with one algorithm, not with {' and '.join(algorithms)}")
    return found


def _check_shared(name: str, group: Sequence[tuple[int, AgentEntry, PolicyConfig]], report: ReportProblem) -> None:
    """Check that agents that share a policy have the same configuration of it."""
    _, first, policy = group[0]
    for index, entry, other in group[1:]:
        if other != policy:
            where = ("agent_config", index, "policy")
            report(where, f"{first.name} and {entry.name} share the policy {name!r}, but configure it differently")
