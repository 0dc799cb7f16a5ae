"""`EnvironmentSpec`: the specification of a validated environment, made of plugins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from safe_inspect.dones.base import DoneFunction
from safe_inspect.dones.shared import SharedDoneFunction
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.platforms.base import Controller, Part, Platform, Sensor
from safe_inspect.platforms.sensor_errors import Measured
from safe_inspect.plugins.functor import Named
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.rewards.base import Reward
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.simulators.resets.plan import ResetPlan
from safe_inspect.simulators.simulator import Simulator


@dataclass(frozen=True)
class AgentSpec:
    """Specification of an agent: its platform, observation, action, rewards and dones.

    Attributes:
        name: Name of the agent.
        platform: Name of the platform that it controls.
        parts: Parts of the platform, by name.
        glues: Glues, in the order of the observation and the action.
        rewards: Terms of the reward, by name.
        dones: Done functions, by name.
        policy: Name of the agent's policy; agents with the same policy name share one policy.
        scripted_policy: Policy that acts inside the environment, or None if the caller gives the actions.
    """

    name: str
    platform: str
    parts: Mapping[str, Part]
    glues: tuple[Glue, ...]
    rewards: tuple[Named[Reward], ...]
    dones: tuple[Named[DoneFunction], ...]
    policy: str = ""
    scripted_policy: ScriptedPolicy | None = None

    def same_terms(self, other: AgentSpec) -> bool:
        """Return whether another agent differs only in its names, so that both can be computed together."""
        renamed = replace(other, name=self.name, platform=self.platform, policy=self.policy)
        return list(self.parts) == list(other.parts) and self == renamed

    @property
    def sensors(self) -> dict[str, Any]:
        """The parts that are sensors, by name; a sensor with errors gives readings with errors."""
        return {
            name: part if part.errors is None else Measured(part, part.errors)
            for name, part in self.parts.items()
            if isinstance(part, Sensor)
        }

    @property
    def observation_glues(self) -> tuple[ObservationGlue, ...]:
        """The glues of the observation, in its order."""
        return tuple(glue for glue in self.glues if isinstance(glue, ObservationGlue))

    @property
    def action_glues(self) -> tuple[ActionGlue, ...]:
        """The glues of the action, in its order."""
        return tuple(glue for glue in self.glues if isinstance(glue, ActionGlue))

    @property
    def safety_filter(self) -> SafetyGlue | None:
        """The enabled safety filter of the action, or None."""
        return next((glue for glue in self.action_glues if isinstance(glue, SafetyGlue) and glue.enabled), None)


@dataclass(frozen=True)
class PolicySpec:
    """Specification of a policy, to train or from a checkpoint, for agents that the caller controls.

    Attributes:
        name: Name of the policy.
        agents: Names of its agents.
        algorithm: Name of the RLlib algorithm; empty for a checkpoint.
        config: RLlib keys, which override the task's.
        checkpoint: Folder of the checkpoint of a policy that is not trained.
        source_policy: Name of the policy in that checkpoint; None if it contains one.
    """

    name: str
    agents: tuple[str, ...]
    algorithm: str
    config: Mapping[str, Any]
    checkpoint: str | None = None
    source_policy: str | None = None

    @property
    def trains(self) -> bool:
        """Whether the policy is trained."""
        return self.checkpoint is None


@dataclass(frozen=True)
class EnvironmentSpec:
    """Specification of an environment.

    Attributes:
        simulator: The simulator.
        platforms: Platforms by name, in agent order.
        agents: The agents; the deputies are in the same order.
        reset: The distribution of initial states.
        step_size: Duration of a step [s].
        seed: Default seed of the run.
        shared_dones: Done functions of all agents together, by name.
        team_safety: The safety filter of all deputies together, if there is one.
        ended_thrust_on: Whether the spacecraft of an agent that has ended keeps its last thrust permanently, as in
            safe-autonomy-sims; otherwise it coasts.
    """

    simulator: Simulator
    platforms: Mapping[str, Platform]
    agents: tuple[AgentSpec, ...]
    reset: ResetPlan
    step_size: float
    seed: int = 0
    shared_dones: tuple[Named[SharedDoneFunction], ...] = ()
    team_safety: TeamSafety | None = None
    ended_thrust_on: bool = False

    @property
    def controlled(self) -> list[AgentSpec]:
        """The agents without a scripted policy, whose actions the caller of the environment gives."""
        return [agent for agent in self.agents if agent.scripted_policy is None]

    def names(self, agent: AgentSpec) -> dict[str, set[str]]:
        """Return the names that the fields of an agent's plugins may refer to, by kind."""
        return {**world_names(self.platforms, self.reset, self.simulator), **agent_names(agent.parts, agent.dones)}


def world_names(platforms: Iterable[str], reset: ResetPlan, simulator: Simulator) -> dict[str, set[str]]:
    """Return the names that all agents share, by kind: entities, platforms, and the bodies that components act on."""
    platforms = set(platforms)
    return {
        "entity": {*platforms, *reset.entities},
        "platform": platforms,
        "points": {name for component in simulator.compose()[1] for name in component.bodies},
    }


def agent_names(parts: Mapping[str, Part], dones: Iterable[Named[DoneFunction]]) -> dict[str, set[str]]:
    """Return the names that belong to one agent, by kind: sensors, controllers and done functions."""
    return {
        "sensor": {name for name, part in parts.items() if isinstance(part, Sensor)},
        "controller": {name for name, part in parts.items() if isinstance(part, Controller)},
        "done": {named.name for named in dones},
    }
