"""Rewards for each step of an episode, and for its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import DoneName
from safe_inspect.rewards.base import Reward, paid_if
from safe_inspect.simulators import Group, Step, World
from safe_inspect.simulators.row_terms import EnvironmentArray, RowTerm
from safe_inspect.tasks.inspection.completion import has_reached
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveDuration


class LiveTimestepReward(Reward):
    """Pay `step_reward` in every step that ends no later than `max_time_rewarded`; shape (R,).

    Attributes:
        step_reward: Reward for a step [-].
        max_time_rewarded: Time since the reset until which steps are paid [s].
    """

    step_reward: float = 0.001
    max_time_rewarded: PositiveDuration = 3000.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: the reward of the step."""
        return paid_if(has_reached, self.step_reward, (self.max_time_rewarded, EnvironmentArray("time")))


class WinLoseDoneReward(Reward):
    """Pay `scale` in a step in which a done function ends the episode; shape (R,).

    Attributes:
        scale: Reward for that end [-].
        done_name: Name of one of the agent's done functions, which replaces `done`.
        done_status: Expected status of the end. Default: the status of the done function.
        done: The done function.
    """

    scale: float = -1.0
    done_name: DoneName | None = None
    done_status: Literal["win", "lose", "draw"] | None = None
    done: functor_field("done") = "MaxDistanceDoneFunction"  # type: ignore[valid-type]

    def with_dones(self, dones: Mapping[str, Any]) -> WinLoseDoneReward:
        """Return the reward with the done function of the name `done_name`.

        Args:
            dones: The agent's done functions by name.

        Raises:
            ValueError: The done function ends episodes with another status.
        """
        done: Any = self.done if self.done_name is None else dones[self.done_name]
        if self.done_status is not None and done.status.name.lower() != self.done_status:
            raise ValueError(
                f"{done.registered_name} ends episodes with `{done.status.name.lower()}`, not with "
                f"`{self.done_status}`; change `done_status`"
            )
        return self.model_copy(update={"done": done})

    def row(self, world: World, group: Group) -> RowTerm | None:
        """Return the row kernel: scale if the done function fires, otherwise 0."""
        done: Any = self.done
        term = done.row(world, group)
        return None if term is None else paid_if(term.kernel, self.scale, term.inputs)

    def __call__(self, step: Step) -> FloatArray:
        """Return scale where the done function fires, otherwise 0, shape (R,)."""
        done: Any = self.done
        return np.where(done(step), self.scale, 0.0)
