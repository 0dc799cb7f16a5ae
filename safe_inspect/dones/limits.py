"""Done functors for limits of the time and of the sum of a reward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.plugins.functor import build
from safe_inspect.simulators import Group, Step, World
from safe_inspect.simulators.row_terms import EnvironmentArray, RowTerm
from safe_inspect.tasks.inspection.completion import has_reached
from safe_inspect.types import ArraySpec, BoolArray
from safe_inspect.units import PositiveDuration

#: Largest number of steps of an episode, because step counters may be 32-bit integers.
MAX_HORIZON = 2**31 - 1


class EpisodeLengthDone(DoneFunction):
    """Draw after `horizon` steps: a truncation, not a termination; shape (R,).

    Attributes:
        horizon: Largest number of steps [-].
    """

    status: ClassVar[DoneStatus] = DoneStatus.DRAW
    truncates: ClassVar[bool] = True

    horizon: int = Field(default=1224, ge=1, le=MAX_HORIZON)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the episode has `horizon` steps."""
        return RowTerm(has_reached, (EnvironmentArray("step"), self.horizon))


class TimeoutDoneFunction(DoneFunction):
    """Lose when the time since the reset reaches `max_sim_time`: a termination, not a truncation; shape (R,).

    The end is part of the task, which penalises time.

    Attributes:
        max_sim_time: Largest time [s].
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    max_sim_time: PositiveDuration = 2000.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the time has elapsed."""
        return RowTerm(has_reached, (EnvironmentArray("time"), self.max_sim_time))


_SUM = "sum"


class TerminalRewardSaturationDoneFunction(DoneFunction):
    """Lose when the sum of a reward over the episode reaches a limit; shape (R,).

    Attributes:
        reward_functor: Name of the reward.
        reward_config: Fields of the reward.
        limit: The limit of the sum [-].
        bound: ``lower`` ends the episode if the sum is at most `limit`, ``upper`` if it is at least `limit`.
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    reward_functor: str = "DockingVelocityConstraintReward"
    reward_config: dict[str, Any] = Field(default_factory=dict)
    limit: float = -5.0
    bound: Literal["lower", "upper"] = "lower"

    _reward: Any = PrivateAttr()

    @model_validator(mode="after")
    def _build_reward(self) -> TerminalRewardSaturationDoneFunction:
        self._reward = build("reward", {"functor": self.reward_functor, "config": self.reward_config})
        return self

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Return the sum as an array to store."""
        return {_SUM: ArraySpec(())}

    def remember(self, step: Step, name: str) -> None:
        """Add the reward of a step to the sum."""
        total = step.after.memory(name, _SUM)
        total += np.asarray(self._reward(step)).reshape(total.shape)

    def __call__(self, step: Step) -> BoolArray:
        """Return the rows whose sum has reached the limit, shape (R,)."""
        total = step.after.memory(self.memory_key(step.after), _SUM).reshape(-1)
        return np.asarray(total <= self.limit if self.bound == "lower" else total >= self.limit)
