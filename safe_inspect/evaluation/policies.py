"""Policies for `rollout`: functions of observations, baselines, and the dispatcher that asks them for actions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic_core import PydanticCustomError

from safe_inspect.config.report import functor_mistakes
from safe_inspect.config.spec import EnvironmentSpec, world_names
from safe_inspect.environments.finite_checks import all_finite
from safe_inspect.environments.group import AgentGroup
from safe_inspect.environments.layout import Layout
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import ArgumentError, SafeInspectError, did_you_mean, not_named
from safe_inspect.plugins.functor import build
from safe_inspect.plugins.registry import registry
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Maps observations (float32, shape (R, O)) to actions (shape (R, A)). A policy that controls K agents in N
#: environments gets R = N * K rows, ordered by environment. A policy that keeps a state between steps has a method
#: ``begin(flight: Flight)``, which is called before the first step of every batch.
#:
#: If a policy has a method ``decide(observation, rows, step)`` and no true attribute ``recurrent``, `decide` is called
#: instead, and only for the rows whose episode is running and whose action is used in the step. It maps observations
#: (Q, O), with their row indices among the R rows, shape (Q,), to actions (Q, A). `step` counts the steps from 0.
Policy: TypeAlias = Callable[[NDArray[np.float32]], AnyArray]

#: Name of each baseline -> name of its scripted policy, which is used with its default values.
BASELINES: Mapping[str, str] = MappingProxyType(
    {"zero-thrust": "ZeroThrust", "random": "RandomThrust", "inspector": "NaturalMotionInspector"}
)


@dataclass(frozen=True)
class Flight:
    """Description of a batch of episodes, passed to a policy before the first step.

    Attributes:
        slots: Global index of the environment slot of each row, shape (R,).
        observation: Layout of the observation.
        action: Layout of the action.
        deputies: Index of the deputy of each row, shape (R,).
    """

    slots: IntArray
    observation: Layout
    action: Layout
    deputies: IntArray


def require_finite_rows(observation: NDArray[np.float32]) -> None:
    """Raise an error if observations contain NaN or infinity, for which a policy has no meaningful action.

    Args:
        observation: Observations, shape (R, O).

    Raises:
        ArgumentError: A value is NaN or infinite.
    """
    if not all_finite(observation):
        row, element = np.argwhere(~np.isfinite(observation))[0].tolist()
        raise ArgumentError(
            f"the observations contain NaN or infinity: element {element} of row {row} is {observation[row, element]}; "
            "a policy takes finite numbers only"
        )


def baseline(name: str) -> ScriptedPolicy:
    """Return a baseline, or any scripted policy with its default values, by name.

    Raises:
        SafeInspectError: There is no policy of that name, or it has fields without defaults.
    """
    try:
        plugin = build("policy", BASELINES.get(name, name))
    except PydanticCustomError as error:
        known = {*BASELINES, *(registered for registered, _ in registry.items("policy"))}
        if name not in known and "." not in name:
            raise SafeInspectError(f"no scripted policy {name!r}; {did_you_mean(name, known)}") from None
        raise SafeInspectError(f"scripted policy {name!r}: {functor_mistakes(error)}") from None
    assert isinstance(plugin, ScriptedPolicy), "the registry returns a plugin of the requested kind"
    return plugin


def with_scripted(
    spec: EnvironmentSpec, policy: ScriptedPolicy | str, agents: Iterable[str] | None = None
) -> EnvironmentSpec:
    """Return the task with agents that a scripted policy controls inside the environment.

    Args:
        spec: The task.
        policy: The plugin, or the name of a baseline or of any scripted policy.
        agents: Names of the agents; all agents by default.

    Raises:
        SafeInspectError: There is no such policy or agent, or the policy refers to something that the task does not
            have.
    """
    plugin = baseline(policy) if isinstance(policy, str) else policy
    names = [agent.name for agent in spec.agents]
    chosen = names if agents is None else list(agents)
    for name in chosen:
        if name not in names:
            raise SafeInspectError(f"no agent is named {name!r}; {did_you_mean(name, names)}")
    known = world_names(spec.platforms, spec.reset, spec.simulator)
    for name, kind in plugin.references().items():
        value = getattr(plugin, name)
        if value is not None and value not in known.get(kind, {value}):
            raise SafeInspectError(f"the `{name}` of {plugin.registered_name}: {not_named(kind, value, known[kind])}")
    flown = tuple(replace(agent, scripted_policy=plugin) if agent.name in chosen else agent for agent in spec.agents)
    return replace(spec, agents=flown)


#: One policy for all controlled agents, or a mapping from the name of each agent to its policy.
Policies = Policy | ScriptedPolicy | Mapping[str, Policy | ScriptedPolicy]


def assign(spec: EnvironmentSpec, policies: Policies) -> tuple[EnvironmentSpec, dict[str, Policy]]:
    """Return the task with the scripted policies inside it, and the policy of each controlled agent.

    Controlled agents are those without a scripted policy in the task.

    Raises:
        ArgumentError: The task or a policy has a wrong type.
        SafeInspectError: An agent has no policy, or a policy has no agent.
    """
    if not isinstance(spec, EnvironmentSpec):
        raise ArgumentError(
            f"a task must be an EnvironmentSpec, got {spec!r:.60}; `load_spec` returns that of a file or an id"
        )
    outside = [agent.name for agent in spec.controlled]
    if not isinstance(policies, Mapping):
        policies = dict.fromkeys(outside, policies)
    for name in policies:
        if name not in outside:
            known = f"; {did_you_mean(name, outside)}" if outside else ""
            flies = any(agent.name == name for agent in spec.agents)
            what = f"the agent {name!r} is controlled by the task's policy" if flies else f"no agent is named {name!r}"
            raise SafeInspectError(
                f"a policy is given for an agent that is not controlled by the caller: {what}{known}"
            )
    missing = [name for name in outside if name not in policies]
    if missing:
        raise SafeInspectError(f"no policy is given for {', '.join(missing)}; give one for each agent")
    flying: dict[str, Policy] = {}
    for name, policy in policies.items():
        if isinstance(policy, type) or not callable(policy):
            hint = "`baseline` returns scripted policies"
            if isinstance(policy, type):
                hint = f"give an object, {policy.__name__}(...)"
            raise ArgumentError(f"the policy {policy!r:.60} cannot be called with observations; {hint}")
        if isinstance(policy, ScriptedPolicy):
            spec = with_scripted(spec, policy, [name])
        else:
            flying[name] = policy
    return spec, flying


@dataclass
class _Assignment:
    """A policy and the agents that it controls, each as (index of the acting group, index in the group).

    The observation and the action of all of them are those of `group`.
    """

    policy: Any
    group: AgentGroup
    agents: list[tuple[int, int]] = field(default_factory=list)


class PolicyDispatcher:
    """Policies of the controlled agents of a batch. A policy of several agents is called once per step.

    Args:
        environment: The batch.
        flying: The policy of each controlled agent, by the agent's name.
        first_slot: Global index of the environment slot of the first row.

    Attributes:
        selective: Whether every policy has a method `decide`, so that it is used instead of a call.

    Raises:
        SafeInspectError: One policy controls agents whose observations or actions differ.
    """

    def __init__(self, environment: TeamEnvironment, flying: Mapping[str, Policy], first_slot: int) -> None:
        self._shapes = [(environment.num_envs, group.size, group.action_layout.size) for group in environment.acting]
        self.selective = all(hasattr(one, "decide") and not getattr(one, "recurrent", False) for one in flying.values())
        self._assigned: dict[int, _Assignment] = {}
        for index, group in enumerate(environment.acting):
            for member, name in enumerate(group.agents):
                policy = flying[name]
                assigned = self._assigned.setdefault(id(policy), _Assignment(policy, group))
                for what in ("observation_layout", "action_layout"):
                    if getattr(group, what).names != getattr(assigned.group, what).names:
                        raise SafeInspectError(
                            f"one policy controls {assigned.group.agents[0]} and {name}, which have different "
                            f"{what.partition('_')[0]}s; give each agent a policy"
                        )
                assigned.agents.append((index, member))
        for assigned in self._assigned.values():
            begin = getattr(assigned.policy, "begin", None)
            if begin is not None:
                begin(_flight(environment, assigned, first_slot))

    def __call__(
        self, observations: Sequence[AnyArray], asked: Sequence[BoolArray], rows: IntArray, step: int
    ) -> list[AnyArray]:
        """Return the actions of every acting group, shape (M, G, A); 0 for agents that do not decide in this step.

        Args:
            observations: For each acting group, shape (M, G, O); if `selective`, those of agents that do not decide may
                be NaN.
            asked: For each acting group the mask of the agents that decide: their episode is running and their action
                is used, shape (M, G).
            rows: Indices of the M environments in the batch, shape (M,).
            step: Number of the step, from 0.

        Raises:
            ValueError: A policy's actions have a wrong shape.
        """
        actions = [np.zeros((len(rows), *shape[1:])) for shape in self._shapes]
        for assigned in self._assigned.values():
            seen = np.stack([observations[index][:, member] for index, member in assigned.agents], axis=1)
            mask = np.stack([asked[index][:, member] for index, member in assigned.agents], axis=1)
            row, place = np.nonzero(mask)
            if not self.selective:
                found = _checked(assigned, assigned.policy(seen.reshape(mask.size, -1)), mask.size)[mask.reshape(-1)]
            elif len(row):
                numbers = rows[row] * len(assigned.agents) + place
                found = _checked(assigned, assigned.policy.decide(seen[mask], numbers, step), len(row))
            for number, (index, member) in enumerate(assigned.agents if len(row) else ()):
                own = place == number
                actions[index][row[own], member] = found[own]
        return actions


def _checked(assigned: _Assignment, action: Any, rows: int) -> AnyArray:
    """Return the actions of a policy after a check of their shape.

    Raises:
        ValueError: The shape is not (rows, A).
    """
    found, wanted = np.asarray(action), (rows, assigned.group.action_layout.size)
    if found.shape != wanted:
        raise ValueError(f"the policy returned actions of shape {found.shape}; expected {wanted}")
    return found


def _flight(environment: TeamEnvironment, assigned: _Assignment, first_slot: int) -> Flight:
    count = environment.num_envs
    deputies = [environment.acting[index].first + member for index, member in assigned.agents]
    return Flight(
        slots=np.repeat(first_slot + np.arange(count), len(deputies)),
        observation=assigned.group.observation_layout,
        action=assigned.group.action_layout,
        deputies=np.tile(deputies, count),
    )
