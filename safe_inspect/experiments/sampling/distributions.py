"""The distributions of actions that the batched runner draws from and the fast learner learns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from gymnasium.spaces import Box, MultiDiscrete
from ray.rllib.core.distribution.torch.torch_distribution import TorchDiagGaussian, TorchMultiCategorical

from safe_inspect.environments.layout import Layout
from safe_inspect.experiments.sampling.categorical import draw_choices
from safe_inspect.experiments.sampling.gaussian import Words, draw_actions
from safe_inspect.types import AnyArray, IntArray


class Distribution(Protocol):
    """From the outputs of a policy's net to actions."""

    @property
    def inputs(self) -> int:
        """How many outputs of the net it takes."""

    def draw(
        self,
        inputs: AnyArray,
        explore: bool,
        seed: np.uint64,
        slot: Words,
        episode: IntArray,
        step: IntArray,
        agent: int,
        action: AnyArray,
        log_probability: AnyArray,
    ) -> None:
        """Draw the actions of one agent in N environments; see `draw_actions` for the arguments."""


@dataclass(frozen=True)
class Gaussian:
    """Independent normal distributions of A real numbers.

    Attributes:
        width: A.
    """

    width: int

    @property
    def inputs(self) -> int:
        """Means and logarithms of the standard deviations."""
        return 2 * self.width

    def draw(self, inputs: AnyArray, explore: bool, *where: Any) -> None:
        """Draw actions."""
        draw_actions(inputs, explore, *where)


class Categorical:
    """Independent choices of A indices.

    Args:
        sizes: Number of values of each.
    """

    def __init__(self, sizes: tuple[int, ...]) -> None:
        self.sizes: IntArray = np.array(sizes, dtype=np.int64)

    @property
    def inputs(self) -> int:
        """The logits."""
        return int(self.sizes.sum())

    def draw(self, inputs: AnyArray, explore: bool, *where: Any) -> None:
        """Draw actions."""
        draw_choices(inputs, self.sizes, explore, *where)


def distribution_of(layout: Layout) -> Distribution:
    """Return the distribution of a policy for an action."""
    return Categorical(layout.choices) if layout.choices else Gaussian(layout.size)


def distribution_of_module(module: Any) -> Distribution | None:
    """Return the distribution of RLlib's module in sampling and in training; None when it is none of these."""
    try:
        kinds = {module.get_exploration_action_dist_cls(), module.get_train_action_dist_cls()}
    except (AttributeError, NotImplementedError):
        return None
    space = module.action_space
    if isinstance(space, Box) and kinds == {TorchDiagGaussian}:
        return Gaussian(int(np.prod(space.shape)))
    # RLlib derives a class of its own for each number of choices.
    if isinstance(space, MultiDiscrete) and all(kind.__bases__ == (TorchMultiCategorical,) for kind in kinds):
        return Categorical(tuple(int(count) for count in space.nvec))
    return None
