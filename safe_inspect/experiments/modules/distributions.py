"""The action distribution of a policy, among those that the batched runner and the fast learner support."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, MultiDiscrete
from ray.rllib.core.distribution.torch.torch_distribution import (
    TorchDiagGaussian,
    TorchMultiCategorical,
    TorchSquashedGaussian,
)

from safe_inspect.environments.layout import Layout
from safe_inspect.experiments.modules.dqn_policy import DqnPolicy
from safe_inspect.experiments.modules.hurdle import TorchHurdle
from safe_inspect.random.action_draws import Categorical, Distribution, Gaussian, Greedy, SquashedGaussian
from safe_inspect.random.hurdle_draws import Hurdle


def distribution_of(layout: Layout) -> Distribution:
    """Return the distribution of a policy whose action has the given layout."""
    if layout.choices:
        return Categorical(layout.choices)
    return Gaussian(layout.size) if layout.coast is None else Hurdle(layout.size - 1, len(layout.coast.durations))


def distribution_of_module(module: Any) -> Distribution | None:
    """Return the distribution of RLlib's module in sampling and in training; None if it is not supported."""
    if isinstance(module, DqnPolicy):
        return Greedy(module.choices)
    try:
        kinds = {module.get_exploration_action_dist_cls(), module.get_train_action_dist_cls()}
    except (AttributeError, NotImplementedError):
        return None
    space = module.action_space
    for kind in kinds:
        if issubclass(kind, TorchHurdle):
            return Hurdle(kind.numbers, kind.choices)
    if isinstance(space, Box) and kinds == {TorchDiagGaussian}:
        return Gaussian(int(np.prod(space.shape)))
    if isinstance(space, Box) and kinds == {TorchSquashedGaussian}:
        return SquashedGaussian(int(np.prod(space.shape)))
    # RLlib derives a separate class for each number of choices.
    if isinstance(space, MultiDiscrete) and all(kind.__bases__ == (TorchMultiCategorical,) for kind in kinds):
        return Categorical(tuple(int(count) for count in space.nvec))
    return None
