"""`TeamSpaces`: stands where RLlib expects an environment."""

from __future__ import annotations

from gymnasium import spaces as gym_spaces

from safe_inspect.environments.facades.spaces import action_space, box
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.experiments.sampling.sampler import AgentSlot


class TeamSpaces:
    """Stands where RLlib expects an environment: it knows the spaces, and holds the batch.

    Args:
        team: The environments.
        slots: Its agents that act from outside.
        several: Whether RLlib sees several agents.
    """

    def __init__(self, team: TeamEnvironment, slots: tuple[AgentSlot, ...], several: bool) -> None:
        self.team = team
        self.num_envs = team.num_envs
        groups = [team.acting[slot.group] for slot in slots]
        self.by_agent = {
            slot.agent: (box(group.observation_layout), action_space(group.action_layout))
            for slot, group in zip(slots, groups, strict=True)
        }
        observation, action = (
            gym_spaces.Dict({agent: pair[index] for agent, pair in self.by_agent.items()}) for index in (0, 1)
        )
        only = slots[0].agent
        self.single_observation_space = self.observation_space = observation if several else observation[only]
        self.single_action_space = self.action_space = action if several else action[only]

    @property
    def unwrapped(self) -> TeamSpaces:
        """The same: nothing is wrapped."""
        return self

    def close(self) -> None:
        """Nothing is to be closed."""
