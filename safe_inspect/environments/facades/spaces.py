"""Gymnasium spaces of layouts, controlled agents by name, and actions that are a single index."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete

from safe_inspect.environments.facades.arguments import action_array
from safe_inspect.environments.layout import Layout
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import ArgumentError, SafeInspectError, did_you_mean
from safe_inspect.types import AnyArray, IntArray


def box(layout: Layout) -> Box:
    """Return the float32 box of a layout; a bound that float32 cannot represent is rounded outwards."""
    low, high = layout.low.astype(np.float32), layout.high.astype(np.float32)
    low = np.where(low > layout.low, np.nextafter(low, np.float32(-np.inf)), low)
    high = np.where(high < layout.high, np.nextafter(high, np.float32(np.inf)), high)
    return Box(low, high, dtype=np.float32)


def action_space(layout: Layout) -> Box | MultiDiscrete:
    """Return the space of an action: indices of levels if the layout is discrete, else a box."""
    return MultiDiscrete(list(layout.choices)) if layout.choices else box(layout)


class AgentsByName:
    """The controlled agents of an environment.

    Args:
        environment: The environment.

    Attributes:
        places: For each agent, in order, the index of its group among the acting groups, and its index in the group.
        observation_spaces: Space of one observation, by agent.
        action_spaces: Space of one action, by agent.
    """

    def __init__(self, environment: TeamEnvironment) -> None:
        groups = environment.acting
        self.places = {agent: (i, k) for i, group in enumerate(groups) for k, agent in enumerate(group.agents)}
        self.observation_spaces = {agent: box(groups[i].observation_layout) for agent, (i, _) in self.places.items()}
        self.action_spaces = {agent: action_space(groups[i].action_layout) for agent, (i, _) in self.places.items()}

    def split(self, groups: Sequence[AnyArray]) -> dict[str, AnyArray]:
        """Return the arrays of each agent, shape (N, ...), from those of the acting groups, shape (N, G, ...)."""
        return {agent: groups[index][:, member] for agent, (index, member) in self.places.items()}


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


def flat_space(choices: Sequence[int]) -> Discrete[np.int64]:
    """Return the space with one index for each combination of choices, given their numbers of values K_1 to K_A."""
    return Discrete(int(np.prod(choices)))


def from_flat(index: AnyArray | int, choices: Sequence[int]) -> IntArray:
    """Return the choices that an index encodes, the last choice varying fastest, int64, shape (..., A)."""
    return np.stack(np.unravel_index(np.asarray(index, dtype=np.int64), tuple(choices)), axis=-1)


class FlatDiscreteActions(gymnasium.ActionWrapper[Any, Any, Any]):
    """Wrapper that makes an environment's action a single index: three controllers of three levels make 27 choices.

    Index i encodes the levels ``numpy.unravel_index(i, nvec)``, the last controller varying fastest. Learners such as
    DQN need such an action.

    Args:
        env: An environment whose actions are levels (`gymnasium.spaces.MultiDiscrete`).

    Raises:
        SafeInspectError: The actions are real numbers.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        if not isinstance(env.action_space, MultiDiscrete):
            raise SafeInspectError("the actions are real numbers; use a task with levels of thrust")
        super().__init__(env)
        self._counts = tuple(int(count) for count in env.action_space.nvec)
        self._last = int(np.prod(self._counts)) - 1
        self.action_space = flat_space(self._counts)

    def action(self, action: Any) -> Any:
        """Return the levels that an index encodes, int64, shape (A,).

        Raises:
            ArgumentError: The action is not an index of the space.
        """
        index = np.asarray(action)
        if index.ndim or index != np.clip(np.floor(index), 0, self._last):
            raise ArgumentError(f"the action is {action!r}; expected a whole number from 0 to {self._last}")
        return from_flat(int(index), self._counts)
