"""`EnvironmentSpec`: a validated environment, made of plugins; what a configuration becomes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from safe_inspect.dones.base import DoneFunction
from safe_inspect.functor import Named
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.platforms.base import Part, Platform, Sensor
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.inspection_simulator import Simulator
from safe_inspect.simulators.reset import ResetPlan


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
    """

    name: str
    platform: str
    parts: Mapping[str, Part]
    glues: tuple[Glue, ...]
    rewards: tuple[Named[Reward], ...]
    dones: tuple[Named[DoneFunction], ...]

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
class EnvironmentSpec:
    """A whole environment.

    Attributes:
        simulator: The simulator.
        platforms: Platforms by name, in agent order.
        agents: The agents.
        reset: How an episode begins.
        step_size: Length of a step [s].
        seed: Seed of the run unless one is given.
    """

    simulator: Simulator
    platforms: Mapping[str, Platform]
    agents: tuple[AgentSpec, ...]
    reset: ResetPlan
    step_size: float
    seed: int = 0
