"""The sum of a reward has reached a limit."""

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
    """Lose when the sum of a reward over the episode has reached a limit; shape (R,).

    Attributes:
        reward_functor: Name of the reward.
        reward_config: Its fields.
        limit: The limit of the sum [-].
        bound: ``lower``: the episode ends at a sum of at most `limit`; ``upper``: of at least that.
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
        """Declare the sum."""
        return {_SUM: ArraySpec(())}

    def remember(self, step: Step, name: str) -> None:
        """Add the reward of a step."""
        total = step.after.memory(name, _SUM)
        total += np.asarray(self._reward(step)).reshape(total.shape)

    def __call__(self, step: Step) -> BoolArray:
        """Return the rows whose sum has reached the limit, shape (R,)."""
        total = step.after.memory(self.memory_key(step.after), _SUM).reshape(-1)
        return np.asarray(total <= self.limit if self.bound == "lower" else total >= self.limit)
