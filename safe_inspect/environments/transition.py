"""Results of a step: `Transition` for a group of agents, `TeamTransition` for all of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from safe_inspect.rta.base import TeamFiltered
from safe_inspect.simulators.view import Step
from safe_inspect.types import AnyArray, BoolArray, FloatArray


@dataclass  # not frozen: one is made in every step, and freezing would double the time for that
class Transition:
    """Result of one step for the agents of a group. Arrays have N rows, and G agents where the shape says so.

    An agent that had ended before the step does not take part in it: its reward and terms are 0, it is neither
    terminated nor truncated again, and its status is the one with which it ended.

    Attributes:
        observation: Observation at the end of the step, before any reset, float32, shape (N, G, O).
        reward: Sum of the reward terms [-], shape (N, G).
        terms: Reward terms by name, each of shape (N, G).
        active: Whether the agent took part in the step, shape (N, G).
        terminated: Whether the agent's episode ended for a reason that does not truncate, shape (N, G).
        truncated: Whether the agent's episode ended only by what truncates, a done function such as a time limit, or a
            draw of a shared done, shape (N, G).
        status: `DoneStatus`, int8, shape (N, G).
        step: The step as passed to the rewards and done functions.
    """

    observation: AnyArray
    reward: FloatArray
    terms: dict[str, FloatArray]
    active: BoolArray
    terminated: BoolArray
    truncated: BoolArray
    status: AnyArray
    step: Step

    @cached_property
    def done(self) -> BoolArray:
        """Whether the agent's episode ended in this step, shape (N, G)."""
        return self.terminated | self.truncated


@dataclass
class TeamTransition:
    """Result of one step for all agents.

    Attributes:
        groups: The transition of every group, in agent order.
        over: Whether the episode has ended for every controlled agent, shape (N,).
        outcome: Outcome of the episode for the team, `DoneStatus`, int8, shape (N,): lost when any agent has lost, else
            won when any agent has won, else a draw when any agent has ended with a draw.
        filtered: Result of the team's safety filter, if there is one.
    """

    groups: tuple[Transition, ...]
    over: BoolArray
    outcome: AnyArray
    filtered: TeamFiltered | None = None
