"""The controlled agents by name, for façades whose inputs and outputs are dictionaries."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TypeVar

from safe_inspect.environments.facades.action_arrays import action_array
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import AgentError, SafeInspectError, did_you_mean
from safe_inspect.types import AnyArray

Space = TypeVar("Space")


@dataclass(frozen=True)
class Place:
    """Position of a controlled agent in the arrays of the core.

    Attributes:
        group: Index of the agent's group among the acting groups.
        member: Index of the agent in the group.
    """

    group: int
    member: int


def places_of(environment: TeamEnvironment) -> dict[str, Place]:
    """Return the place of every controlled agent, in agent order."""
    return {
        agent: Place(index, member)
        for index, group in enumerate(environment.acting)
        for member, agent in enumerate(group.agents)
    }


def space_of(spaces: Mapping[str, Space], agent: str) -> Space:
    """Return the space of an agent.

    Raises:
        AgentError: There is no controlled agent with that name.
    """
    if agent not in spaces:
        raise AgentError(f"there is no controlled agent {agent!r}; {did_you_mean(str(agent), spaces)}")
    return spaces[agent]


def checked_actions(
    actions: Mapping[str, AnyArray], wanted: Collection[str], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, AnyArray]:
    """Return the actions as arrays.

    Args:
        actions: Actions by agent.
        wanted: Agents that act now.
        shapes: Shape of the action of every controlled agent.

    Raises:
        SafeInspectError: Actions are missing, are for an agent that does not act, or have the wrong shape; one message
            lists all problems.
    """
    if not isinstance(actions, Mapping):
        raise SafeInspectError(f"actions: expected a dictionary of actions by agent, got a {type(actions).__name__}")
    found = {agent: action_array(action, shapes.get(agent)) for agent, action in actions.items()}
    problems = [f"none is given for {agent}" for agent in wanted if agent not in found]
    for agent, (_, mistake) in found.items():
        if agent not in shapes:
            problems.append(f"there is no controlled agent {agent!r}, {did_you_mean(str(agent), shapes)}")
        elif agent not in wanted:
            problems.append(f"{agent} has ended and takes none until the next reset")
        elif mistake:
            problems.append(f"that for {agent} {mistake.replace('; ', ', ')}")
    if problems:
        raise SafeInspectError(f"actions: {'; '.join(problems)}")
    return {agent: array for agent, (array, _) in found.items()}
