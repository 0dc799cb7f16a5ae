"""The assignment of policies to agents, with the checks that involve several of them."""

from __future__ import annotations

from collections.abc import Sequence

from safe_inspect.config.messages.report import KeyTuple, ReportProblem
from safe_inspect.config.models.experiment import AgentEntry, ExperimentConfig, PolicyConfig
from safe_inspect.config.spec import PolicySpec


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
