"""Done functor that fires when the sum of a reward reaches a limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.plugins.functor import build
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import Step
from safe_inspect.simulators.world import World
from safe_inspect.types import BoolArray

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
