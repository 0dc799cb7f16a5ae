"""Done functors that end an episode for all its agents."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.dones.base import DoneStatus
from safe_inspect.plugins.plugin import DoneName, Plugin
from safe_inspect.simulators.team import TeamStep
from safe_inspect.types import AnyArray
from safe_inspect.units import PositiveLength

Ending = Literal["win", "lose", "draw"]
#: If agents end with different statuses at once, the first of these counts.
_WORST_FIRST = (DoneStatus.LOSE, DoneStatus.WIN, DoneStatus.DRAW)
#: NumPy integers, because comparing an array with them is ten times as fast as with members of an enumeration.
_RUNNING, _WIN, _LOSE = np.int8(DoneStatus.RUNNING), np.int8(DoneStatus.WIN), np.int8(DoneStatus.LOSE)


class SharedDoneFunction(Plugin):
    """Base class of done functors for all agents. Called with a `TeamStep`, one returns statuses of shape (N,).

    They are configured under ``dones: shared:`` of the environment's configuration.
    """

    kind: ClassVar[str] = "done"

    @abstractmethod
    def __call__(self, step: TeamStep) -> AnyArray:
        """Return the `DoneStatus` of all agents of each environment, 0 where it continues, int8, shape (N,)."""


class CollisionDoneFunction(SharedDoneFunction):
    """All lose when two deputies are closer than `safety_constraint` at the end of the step; shape (N,).

    Deputies whose agents are done also count, as they continue to fly, unless they ended with a status of `exempt`.

    Attributes:
        safety_constraint: Smallest permitted distance between two deputies [m].
        exempt: Statuses after which an agent's deputy no longer counts, such as ``win`` for one that has docked.
    """

    safety_constraint: PositiveLength = 10.0
    exempt: tuple[Ending, ...] = ()

    def __call__(self, step: TeamStep) -> AnyArray:
        """Return `DoneStatus.LOSE` where two deputies have collided, int8, shape (N,)."""
        near = step.after.distance < self.safety_constraint
        if self.exempt:
            gone = np.isin(step.status, [DoneStatus[ending.upper()] for ending in self.exempt])
            one, other = np.triu_indices(step.status.shape[1], 1)
            near = near & ~gone[:, one] & ~gone[:, other]
        return np.where(near.any(axis=-1), _LOSE, _RUNNING)


class MultiagentSuccessDoneFunction(SharedDoneFunction):
    """All win when every agent that has the named done function has won; shape (N,).

    An agent has won if the function ended its episode in this step and it did not lose in the same step, or if its
    episode ended earlier with a win. If no agent has the function, the episode continues, as in safe-autonomy-sims.

    Attributes:
        success_function_name: Name of a done function of the agents.
    """

    success_function_name: DoneName = "SuccessfulInspectionDoneFunction"

    def __call__(self, step: TeamStep) -> AnyArray:
        """Return `DoneStatus.WIN` where every agent has won, int8, shape (N,)."""
        name = self.success_function_name
        if name not in step.has:  # the configuration check warns about it
            return np.zeros(len(step.status), dtype=np.int8)
        asked = np.asarray(step.has[name])
        won = (step.fired[name] & (step.status != _LOSE)) | (step.before.finished == _WIN)
        everybody = (won | ~asked).all(axis=-1)
        return np.where(everybody & asked.any(), _WIN, _RUNNING)


class SetAllDoneFunction(SharedDoneFunction):
    """All end as soon as one agent has ended with one of `statuses`; shape (N,).

    All get the worst of these statuses: lose before win before draw.

    Attributes:
        statuses: Statuses of one agent that end the episode of all agents.
    """

    statuses: tuple[Ending, ...] = Field(default=("win", "lose", "draw"), min_length=1)

    def __call__(self, step: TeamStep) -> AnyArray:
        """Return the worst status of an agent, 0 where none has ended with such a status, int8, shape (N,)."""
        found = np.zeros(len(step.status), dtype=np.int8)
        for status in reversed(_WORST_FIRST):
            if status.name.lower() in self.statuses:
                found[(step.status == status).any(axis=-1)] = status
        return found
