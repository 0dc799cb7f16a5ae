"""What a step gives: `Transition` for a group of agents, `TeamTransition` for all of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from safe_inspect.rta.team import TeamFiltered
from safe_inspect.simulators.view import Step
from safe_inspect.types import AnyArray, BoolArray, FloatArray


@dataclass  # not frozen: one is made in every step, and freezing doubles the time that takes
class Transition:
    """What one step gives for the agents of a group; every array has N rows, and G agents where it says so.

    An agent that had ended before the step took no part in it: its reward and terms are 0, it is neither terminated
    nor truncated again, and its status is the one that it ended with.

    Attributes:
        observation: Observation at the end of the step, before any reset, float32, shape (N, G, O).
        reward: Sum of the terms [-], shape (N, G).
        terms: Reward terms by name, each of shape (N, G).
        active: The agent took part in the step, shape (N, G).
        terminated: The agent's episode ended in the task's own way, shape (N, G).
        truncated: The agent's episode ended by a limit of time alone, shape (N, G).
        status: `DoneStatus`, int8, shape (N, G).
        step: The step as the functors saw it.
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
        """The agent's episode ended in this step, shape (N, G)."""
        return self.terminated | self.truncated


@dataclass
class TeamTransition:
    """What one step gives for all agents.

    Attributes:
        groups: The transition of every group, in agent order.
        over: The episode has ended for every agent that acts from outside, shape (N,).
        outcome: How the episode stands for the team, `DoneStatus`, int8, shape (N,): lost when any agent has lost, else
            won when any has won, else a draw when any has ended so.
        filtered: What the team's safety filter gave, where there is one.
    """

    groups: tuple[Transition, ...]
    over: BoolArray
    outcome: AnyArray
    filtered: TeamFiltered | None = None
