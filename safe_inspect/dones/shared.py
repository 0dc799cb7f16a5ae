"""Done functors that end an episode for all its agents."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.dones.base import DoneStatus
from safe_inspect.plugins.plugin import DoneName, Plugin
from safe_inspect.simulators.team import TeamStep
from safe_inspect.types import AnyArray, BoolArray
from safe_inspect.units import PositiveLength

Ending = Literal["win", "lose", "draw"]
#: What counts when agents end in several ways at once: the first of these.
_WORST_FIRST = (DoneStatus.LOSE, DoneStatus.WIN, DoneStatus.DRAW)
#: As NumPy's numbers: an array is compared with them ten times as fast as with the members of an enumeration.
_RUNNING, _WIN, _LOSE = np.int8(DoneStatus.RUNNING), np.int8(DoneStatus.WIN), np.int8(DoneStatus.LOSE)


class SharedDoneFunction(Plugin):
    """Ends an episode for all agents: called with a `TeamStep`, it returns how each environment ends, shape (N,).

    It stands under ``dones: shared:`` of the environment's configuration.
    """

    kind: ClassVar[str] = "shared_done"

    @abstractmethod
    def __call__(self, step: TeamStep) -> AnyArray:
        """Return the `DoneStatus` that every agent of an environment gets, 0 where it goes on, int8, shape (N,)."""


class CollisionDoneFunction(SharedDoneFunction):
    """All lose when two deputies are closer than `safety_constraint` at the end of the step; shape (N,).

    Deputies whose agents are done still count, as their spacecraft fly on, unless they ended in one of `exempt`.

    Attributes:
        safety_constraint: Smallest distance of two deputies [m].
        exempt: Endings of an agent after which its deputy counts no more, such as ``win`` for one that has docked.
    """

    safety_constraint: PositiveLength = 10.0
    exempt: tuple[Ending, ...] = ()

    def __call__(self, step: TeamStep) -> AnyArray:
        """Return `DoneStatus.LOSE` where two deputies have collided, int8, shape (N,)."""
        near = step.after.distance < self.safety_constraint
        if self.exempt:
            gone = _ended_in(step.status, self.exempt)
            one, other = np.triu_indices(step.status.shape[1], 1)
            near = near & ~gone[:, one] & ~gone[:, other]
        return _where(near.any(axis=-1), _LOSE)


class MultiagentSuccessDoneFunction(SharedDoneFunction):
    """All win when every agent that has the named done function has won; shape (N,).

    An agent has won when the function ended its episode in this step and it did not lose in the same step, or when it
    had ended with a win before. Where no agent has the function, the episode goes on, as in safe-autonomy-sims.

    Attributes:
        success_function_name: Name of a done function of the agents.
    """

    success_function_name: DoneName = "SuccessfulInspectionDoneFunction"

    def __call__(self, step: TeamStep) -> AnyArray:
        """Return `DoneStatus.WIN` where every agent has won, int8, shape (N,)."""
        name = self.success_function_name
        if name not in step.has:  # the configuration's check warns of it
            return np.zeros(len(step.status), dtype=np.int8)
        asked = np.asarray(step.has[name])
        won = (step.fired[name] & (step.status != _LOSE)) | (step.before.finished == _WIN)
        everybody = (won | ~asked).all(axis=-1)
        return _where(everybody & asked.any(), _WIN)


class SetAllDoneFunction(SharedDoneFunction):
    """All end as soon as one agent has ended in one of `statuses`; shape (N,).

    All get the worst status among those: lose before win before draw.

    Attributes:
        statuses: Endings of an agent that end the episode for all.
    """

    statuses: tuple[Ending, ...] = Field(default=("win", "lose", "draw"), min_length=1)

    def __call__(self, step: TeamStep) -> AnyArray:
        """Return the worst status of an agent, 0 where none has ended so, int8, shape (N,)."""
        found = np.zeros(len(step.status), dtype=np.int8)
        for status in reversed(_WORST_FIRST):
            if status.name.lower() in self.statuses:
                found[(step.status == status).any(axis=-1)] = status
        return found


def _ended_in(status: AnyArray, endings: Sequence[Ending]) -> BoolArray:
    """Return the agents whose status is one of some endings, shape (N, D)."""
    return np.isin(status, [DoneStatus[ending.upper()] for ending in endings])


def _where(rows: BoolArray, status: np.int8) -> AnyArray:
    return np.where(rows, status, _RUNNING)
