"""`EnvironmentSpec`: a validated environment, made of plugins; what a configuration becomes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from safe_inspect.dones.base import DoneFunction
from safe_inspect.dones.shared import SharedDoneFunction
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.platforms.base import Controller, Part, Platform, Sensor
from safe_inspect.plugins.functor import Named
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.rewards.base import Reward
from safe_inspect.rta.team import TeamSafety
from safe_inspect.simulators.resets.plan import ResetPlan
from safe_inspect.simulators.simulator import Simulator


@dataclass(frozen=True)
class AgentSpec:
    """One agent: a platform, and what it sees, does, earns and ends on.

    Attributes:
        name: Name of the agent.
        platform: Name of the platform that it controls.
        parts: Parts of the platform, by name.
        glues: Glues, in the order of the observation and the action.
        rewards: Terms of the reward, by name.
        dones: What ends the episode, by name.
        policy: Name of the policy that flies the agent; agents of one name share one policy.
        scripted_policy: What flies the agent inside the environment; None: actions come from outside.
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
        """Return whether another agent differs in its names alone, so that both can be computed together."""
        return (
            list(self.parts) == list(other.parts)
            and self.parts == other.parts
            and self.glues == other.glues
            and self.rewards == other.rewards
            and self.dones == other.dones
            and self.scripted_policy == other.scripted_policy
        )

    @property
    def sensors(self) -> dict[str, Sensor]:
        """The parts that are sensors, by name."""
        return {name: part for name, part in self.parts.items() if isinstance(part, Sensor)}

    @property
    def observation_glues(self) -> tuple[ObservationGlue, ...]:
        """The glues that make the observation, in its order."""
        return tuple(glue for glue in self.glues if isinstance(glue, ObservationGlue))

    @property
    def action_glues(self) -> tuple[ActionGlue, ...]:
        """The glues that take the action, in its order."""
        return tuple(glue for glue in self.glues if isinstance(glue, ActionGlue))


@dataclass(frozen=True)
class PolicySpec:
    """What trains, or a checkpoint that flies, agents whose actions come from outside the environment.

    Attributes:
        name: Name of the policy.
        agents: Names of the agents that it flies.
        algorithm: Name of the RLlib algorithm; empty for a checkpoint.
        config: RLlib keys, over the task's.
        checkpoint: Folder of the checkpoint of a policy that is not trained.
        source_policy: Name of the policy in that checkpoint; None: it holds one.
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
    """A whole environment.

    Attributes:
        simulator: The simulator.
        platforms: Platforms by name, in agent order.
        agents: The agents; the deputies stand in their order.
        reset: How an episode begins.
        step_size: Length of a step [s].
        seed: Seed of the run unless one is given.
        shared_dones: What ends the episode of all agents, by name.
        team_safety: The safety filter that acts on all deputies together, where there is one.
        ended_thrust_on: Whether the spacecraft of an agent that has ended holds its last thrust for ever, as the
            peer's does; else it coasts.
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

    def names(self, agent: AgentSpec) -> dict[str, set[str]]:
        """Return what the fields of an agent's plugins may name, by kind."""
        return {
            **world_names(self.platforms, self.reset, self.simulator),
            **agent_names(agent.parts, agent.dones),
        }


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
